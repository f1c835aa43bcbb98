"""Writes seeds for fuzz_journal: a journal with one record of each type. Usage: fuzz_journal.py FOLDER"""
import pathlib
import struct
import sys
import zlib


def with_crc(data):
    return data + struct.pack("<I", zlib.crc32(data))


def record(kind, fields):
    body = struct.pack("<Bq", kind, 1000 * kind) + fields
    return with_crc(struct.pack("<I", len(body)) + body)


def text(value):
    return struct.pack("<I", len(value)) + value


header = with_crc(b"SMAPJRNL" + struct.pack("<I", 3) + bytes(range(32)))
records = [record(1, struct.pack("<q", -5) + text(b"0.1.0")), record(2, struct.pack("<I", 7) + bytes(32)),
           record(3, struct.pack("<q", 9) + text(b"door")), record(4, text(b"hall")),
           record(5, struct.pack("<QQ", 1, 2)), record(6, b""), record(7, b""), record(8, b""),
           record(9, struct.pack("<q", 5) + text(b"0.2.0")), record(10, struct.pack("<q", -1)), record(11, text(b"usb")),
           record(12, struct.pack("<IIdI8d", 1, 7, 0.1, 2, *range(8))), record(13, struct.pack("<II", 2, 9)),
           record(14, struct.pack("<II", 2, 9)), record(15, b"")]
folder = pathlib.Path(sys.argv[1])
(folder / "header").write_bytes(header)
(folder / "whole").write_bytes(header + b"".join(records))
(folder / "cut").write_bytes((header + b"".join(records))[:-3])
