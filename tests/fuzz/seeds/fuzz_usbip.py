#!/usr/bin/env python3
"""Writes seed inputs for fuzz_usbip into the folder given: each message, whole and damaged."""
import pathlib
import struct
import sys

DEVLIST = struct.pack(">HHI", 0x0111, 0x8005, 0)
IMPORT = struct.pack(">HHI32s", 0x0111, 0x8003, 0, b"1-1")


def submit(seqnum, into, endpoint, length, setup=bytes(8), data=b"", packets=0):
    return struct.pack(">10I8s", 1, seqnum, 0x10002, into, endpoint, 0, length, 0, packets, 0, setup) + data


def unlink(seqnum, unlinked):
    return struct.pack(">6I24x", 2, seqnum, 0x10002, 0, 0, unlinked)


GET_DEVICE = submit(1, 1, 0, 18, b"\x80\x06\x00\x01\x00\x00\x12\x00")
CODING = submit(2, 0, 0, 7, b"\x21\x20\x00\x00\x00\x00\x07\x00", b"\x00\xc2\x01\x00\x00\x00\x08")
VERSION = submit(3, 0, 2, 3, data=b"VV\n")
STREAM = submit(4, 0, 2, 16, data=b"MD0000108001000\n")
READ = submit(5, 1, 1, 4096)
SEEDS = {
    "list": b"\x07" + DEVLIST + DEVLIST,
    "import": b"\x07" + IMPORT + GET_DEVICE,
    "refused": b"\x07" + IMPORT.replace(b"1-1", b"2-7") + DEVLIST,
    "version": b"\x87" + CODING + VERSION + READ,
    "stream": b"\xff" + STREAM + READ * 6,
    "unlink": b"\xa0" + submit(6, 1, 3, 8) + unlink(7, 6) + unlink(8, 6),
    "clear_halt": b"\x90" + submit(6, 0, 0, 0, b"\x02\x01\x00\x00\x81\x00\x00\x00") + READ,
    "isochronous": b"\x90" + submit(6, 1, 1, 64, packets=8),
    "long": b"\x90" + submit(6, 1, 1, 0x7FFFFFFF),
    "cut": b"\x90" + VERSION[:-1],
}

folder = pathlib.Path(sys.argv[1])
for name, data in SEEDS.items():
    (folder / name).write_bytes(data)
