#!/usr/bin/env python3
"""Writes seed inputs for fuzz_scip into the folder given: each shape of reply, whole and damaged."""
import pathlib
import sys


def line(text: bytes) -> bytes:
    return text + bytes([sum(text) % 64 + 0x30]) + b"\n"


def status(echo: bytes, code=b"00") -> bytes:
    return echo + b"\n" + line(code) + b"\n"


def scan(echo: bytes, characters: int, code=b"99", time=b"0000", data=b"") -> bytes:
    data = data or b"0?X" * (characters // 3 + 1)
    blocks = b"".join(line(data[:characters][i:i + 64]) for i in range(0, characters, 64))
    return echo + b"\n" + line(code) + line(time) + blocks + b"\n"


def parameters(echo: bytes, *texts: bytes) -> bytes:
    return echo + b"\n" + line(b"00") + b"".join(t + b";" + line(t)[-2:] for t in texts) + b"\n"


MD20, MD60 = b"MD0540055901000", b"MD0500055901000"
MULTI = b"ND0540054201000"
SEEDS = {
    "parameters": b"\0\1" + parameters(b"VV", b"PROT:SCIP 2.0", b"SERI:1") + parameters(b"II", b"TIME:j;o[", b"SCSP:x<-y"),
    "full": b"\1\x50" + status(b"MD0000108001000") + scan(b"MD0000108001000", 3243) + status(b"QT"),
    "stream": b"\2\7" + status(MD20) + scan(MD20, 60) + status(MD20, b"21") + status(b"QT") + scan(MD20, 60),
    "intensity": b"\3\7" + status(b"ME0540055901000;abc") + scan(b"ME0540055901000;abc", 120),
    "echoes": b"\4\7" + status(MULTI) + scan(MULTI, 17, data=b"0?X&0?X0?X&0?X0?X"),
    "microseconds": b"\5\7" + scan(b"%" + MD20, 60, time=b"0" * 11) + b"%TM1\n00P\n" + line(b"0" * 11) + b"\n",
    "scip11": b"\6\7SCIP2.0\n0\n\n" + status(b"ZZ", b"0E"),
    "no_blank": b"\7\7" + scan(MD60, 180)[:-1] + scan(MD60, 180),
    "lost_line": b"\7\7" + scan(MD60, 180)[:100] + scan(MD60, 180)[166:] + scan(MD60, 180),
    "endless": b"\7\7" + b"0" * 300 + b"\n" + scan(MD60, 180),
    "cut": b"\7\7" + scan(MD60, 180)[:70],
}

folder = pathlib.Path(sys.argv[1])
for name, data in SEEDS.items():
    (folder / name).write_bytes(data)
