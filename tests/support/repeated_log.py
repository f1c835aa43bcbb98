"""Makes hours of driving of a simulated half-hour: a stretch that ends as it began is driven again and again."""
import collections
import math
import struct

HEADER = struct.Struct(">IqqII")  # of an event in LCM's log format: sync, number, stamp, channel's and message's lengths
SCAN = struct.Struct(">8s q 16s q")  # fingerprint, utime, device_ms and mono_ns, seq; the rest stays as it is
GRID_M, SAME_M, SAME_RAD, SAME_M_S, SAME_RAD_S = 0.025, 0.01, 0.005, 0.05, 0.05
SCAN_S = 0.025


def _turn(a, b):
    return (b - a + math.pi) % (2.0 * math.pi) - math.pi


def _seam(poses, shortest):
    """Scans i < j, `shortest` or more apart, whose poses and speeds are nearest to each other: (how near, i, j)."""
    def motion(i):
        (x, y, yaw), (x1, y1, yaw1) = poses[i], poses[i + 1]
        return math.hypot(x1 - x, y1 - y) / SCAN_S, _turn(yaw, yaw1) / SCAN_S

    there = collections.defaultdict(list)
    for i, (x, y, _) in enumerate(poses[:-1]):
        there[int(x // GRID_M), int(y // GRID_M)].append(i)
    best = None
    for scans in there.values():
        for i in scans:
            for j in scans:
                if j - i < shortest:
                    continue
                (x, y, yaw), (x1, y1, yaw1) = poses[i], poses[j]
                (speed, rate), (speed1, rate1) = motion(i), motion(j)
                off = max(math.hypot(x1 - x, y1 - y) / SAME_M, abs(_turn(yaw, yaw1)) / SAME_RAD,
                          abs(speed1 - speed) / SAME_M_S, abs(rate1 - rate) / SAME_RAD_S)
                if best is None or off < best[0]:
                    best = (off, i, j)
    assert best and best[0] < 1.0, f"no stretch of {shortest} scans ends as it began: {best}"
    return best


def _pose(line):
    _, x, y, _, _, _, z, w = (float(word) for word in line.split())
    return x, y, 2.0 * math.atan2(z, w)


def repeat(log, prefix, minutes, shortest_minutes=10.0):
    """Writes PREFIX.lcmlog, so many minutes of the simulated `log`, and its truth. The file, and in words where the seam is."""
    lines = log.with_name(log.stem + ".truth.tum").read_text().splitlines()
    poses = [_pose(line) for line in lines]
    off, first, end = _seam(poses, int(shortest_minutes * 60 / SCAN_S))
    events = []
    with open(log, "rb") as file:
        for _ in range(end):
            head = file.read(HEADER.size)
            _, _, _, channel, length = HEADER.unpack(head)
            events.append((channel, length, file.read(channel), file.read(length)))
    stamp_us = SCAN.unpack_from(events[0][3])[1]
    wanted = int(minutes * 60 / SCAN_S)
    path = prefix.with_name(prefix.name + ".lcmlog")
    with open(path, "wb") as file, \
            open(prefix.with_name(prefix.name + ".truth.tum"), "w") as truth:
        at = 0
        for number in range(wanted):
            channel, length, name, message = events[at]
            fingerprint, _, clocks, _ = SCAN.unpack_from(message)
            utime = stamp_us + round(number * SCAN_S * 1e6)
            file.write(HEADER.pack(0xEDA1DA01, number, utime, channel, length) + name +
                       SCAN.pack(fingerprint, utime, clocks, number) + message[SCAN.size:])
            truth.write(f"{utime / 1e6:.6f} {lines[at].split(' ', 1)[1]}\n")
            at = at + 1 if at + 1 < end else first
    return path, (f"scans {first} to {end} again and again; at the seam {off:.2f} of 1 cm, 0.3 degrees, 5 cm/s, 3 degrees/s")
