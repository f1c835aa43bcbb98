#!/usr/bin/env python3
"""Writes seed inputs for fuzz_lcmlog into the folder given: whole events, garbage between them, lengths that lie."""
import pathlib
import struct
import sys


def event(channel: bytes, data: bytes, channel_bytes=None, data_bytes=None) -> bytes:
    lengths = (len(channel) if channel_bytes is None else channel_bytes,
               len(data) if data_bytes is None else data_bytes)
    return struct.pack(">IqqII", 0xEDA1DA01, 7, 1000, *lengths) + channel + data


SEEDS = {
    "whole": event(b"SCAN", b"12345") + event(b"POSE", b"") + event(b"ERROR", b"x") + event(b"S", b"\0" * 300),
    "garbage": b"junk" + event(b"SCAN", b"1") + b"\xed\xa1\xda" + event(b"SCAN", b"2") + b"\xed\xa1\xda\x01",
    "lies": event(b"SCAN", b"1", 0, 5) + event(b"SCAN", b"1", 64, 5) + event(b"SCAN", b"1", 4, 0xFFFFFFFF)
            + event(b"SCAN", b"1", 4, 4 << 20) + event(b"SCAN", b"1", 4, 40) + event(b"SCAN", b"2"),
    "cut": event(b"SCAN", b"12345")[:-3],
}

folder = pathlib.Path(sys.argv[1])
for name, data in SEEDS.items():
    (folder / name).write_bytes(data)
