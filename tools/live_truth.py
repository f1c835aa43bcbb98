#!/usr/bin/env python3
"""The true trajectory of a run that hokuyo-sim drove: its --truth file (JSON lines, monotonic clock) and the run's journal
(daemon/journal-format.md), which knows the run's wall clock, become a TUM file for tools/trajectory_error.py."""
import argparse
import json
import math
import struct
import sys


def clock_offset_ns(journal):
    """Wall clock less monotonic clock, from the journal's first record."""
    header = 48
    with open(journal, "rb") as file:
        data = file.read(header + 21)
    if data[:8] != b"SMAPJRNL" or len(data) < header + 21:
        sys.exit(f"{journal}: is no journal of a run")
    _, kind, _, offset_ns = struct.unpack_from("<IBqq", data, header)
    if kind != 1:
        sys.exit(f"{journal}: does not begin with the start of a run")
    return offset_ns


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("journal")
    parser.add_argument("truth")
    parser.add_argument("tum")
    arguments = parser.parse_args()
    offset_ns = clock_offset_ns(arguments.journal)
    with open(arguments.truth, encoding="utf-8") as lines, open(arguments.tum, "w", encoding="utf-8") as tum:
        for line in lines:
            try:
                scan = json.loads(line)
            except ValueError:
                continue  # the last line of a simulator that was ended
            if scan["scanner"] != 1 or "pose" not in scan:
                continue
            x, y, yaw = scan["pose"]
            stamp_s = 1e-9 * (scan["first_beam_ns"] + offset_ns)
            tum.write(f"{stamp_s:.6f} {x:.6f} {y:.6f} 0 0 0 {math.sin(yaw / 2):.9f} {math.cos(yaw / 2):.9f}\n")


if __name__ == "__main__":
    main()
