"""Writes seeds for fuzz_poses: a file of three poses, whole and cut. Usage: fuzz_poses.py FOLDER"""
import pathlib
import struct
import sys
import zlib


def with_crc(data):
    return data + struct.pack("<I", zlib.crc32(data))


header = with_crc(b"SMAPPOSE" + struct.pack("<I", 1))
records = [with_crc(struct.pack("<qQ6dI", 25000 * i, 0, 0.1 * i, 0, 0, 0, 0, 0, 1 if i == 0 else 0)) for i in range(3)]
folder = pathlib.Path(sys.argv[1])
(folder / "whole").write_bytes(header + b"".join(records))
(folder / "cut").write_bytes((header + b"".join(records))[:-5])
