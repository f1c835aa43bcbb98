#!/usr/bin/env python3
"""Writes a seed for fuzz_odometry: a cart that drives, and whose frame jumps once. Usage: fuzz_odometry.py FOLDER"""
import pathlib
import struct
import sys

FINGERPRINT = 0x5cc85c45a6eca696  # of odometry_t (lcm_types_test.cpp)

data = b""
for i in range(60):
    message = struct.pack(">Qq16x3d", FINGERPRINT, 0, 0.03 * i + (10 if i > 40 else 0), 0.0, 0.01 * i)
    data += bytes([40, len(message)]) + message
(pathlib.Path(sys.argv[1]) / "drive").write_bytes(data)
