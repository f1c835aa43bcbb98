#!/usr/bin/env python3
"""The true trajectory of a run that hokuyo-sim drove: its --truth file (JSON lines, monotonic clock) and the run's journal
(daemon/journal-format.md), which knows the run's wall clock, become a TUM file for tools/trajectory_error.py."""
import argparse
import json
import math
import struct
import sys


def clocks_of(journal):
    """(monotonic instant, wall clock less monotonic clock), ns: from when on the run had which, in order."""
    with open(journal, "rb") as file:
        data = file.read()
    clocks, at = [], 48
    while data[:8] == b"SMAPJRNL" and len(data) >= at + 21:
        length, kind, utime_us, offset_ns = struct.unpack_from("<IBqq", data, at)
        if kind in (1, 9):  # the run was started, or goes on
            clocks.append((1000 * utime_us - offset_ns if kind == 9 else 0, offset_ns))
        at += 4 + length + 4
    if not clocks:
        sys.exit(f"{journal}: does not begin with the start of a run")
    return clocks


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("journal")
    parser.add_argument("truth")
    parser.add_argument("tum")
    arguments = parser.parse_args()
    clocks = clocks_of(arguments.journal)
    with open(arguments.truth, encoding="utf-8") as lines, open(arguments.tum, "w", encoding="utf-8") as tum:
        for line in lines:
            try:
                scan = json.loads(line)
            except ValueError:
                continue  # the last line of a simulator that was ended
            if scan["scanner"] != 1 or "pose" not in scan:
                continue
            x, y, yaw = scan["pose"]
            mono_ns = scan["first_beam_ns"]
            offset_ns = [offset for since_ns, offset in clocks if mono_ns >= since_ns][-1]
            stamp_s = 1e-9 * (mono_ns + offset_ns)
            tum.write(f"{stamp_s:.6f} {x:.6f} {y:.6f} 0 0 0 {math.sin(yaw / 2):.9f} {math.cos(yaw / 2):.9f}\n")


if __name__ == "__main__":
    main()
