#!/usr/bin/env python3
"""Compares a trajectory with the true one: RMSE of position and heading after the best rigid SE(2) alignment.

Both are TUM files: "stamp x y z qx qy qz qw" a line, seconds and metres, # for comments. The truth is interpolated at
the stamps of the estimate. The alignment is the closed form of Horn (1987) in the plane, without scale.
"""
import argparse
import bisect
import math
import sys


def wrap(angle):
    return math.remainder(angle, 2.0 * math.pi)


def read_tum(path):
    """[(stamp_s, x_m, y_m, yaw_rad)], sorted by stamp."""
    poses = []
    with open(path, encoding="utf-8") as lines:
        for number, line in enumerate(lines, 1):
            fields = line.split("#")[0].split()
            if not fields:
                continue
            try:
                stamp, x, y, _, qx, qy, qz, qw = map(float, fields)
            except ValueError:
                sys.exit(f"{path}: line {number}: not the 8 numbers \"stamp x y z qx qy qz qw\"")
            poses.append((stamp, x, y, math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))))
    if not poses:
        sys.exit(f"{path}: holds no pose")
    return sorted(poses)


def interpolate(poses, stamps, stamp, max_gap_s):
    """(x, y, yaw) at the stamp, or None outside of the poses or in a gap of more than max_gap_s."""
    after = bisect.bisect_left(stamps, stamp)
    if after < len(poses) and stamps[after] == stamp:
        return poses[after][1:]
    if after == 0 or after == len(poses):
        return None
    t0, x0, y0, yaw0 = poses[after - 1]
    t1, x1, y1, yaw1 = poses[after]
    if t1 - t0 > max_gap_s:
        return None
    share = (stamp - t0) / (t1 - t0)
    return x0 + share * (x1 - x0), y0 + share * (y1 - y0), yaw0 + share * wrap(yaw1 - yaw0)


def moved(pairs, poses=None):
    """Poses (by default the estimates) after the rigid motion that moves the estimates onto the truth: [(x, y, yaw)].
    pairs: [(estimate, truth)]"""
    n = len(pairs)
    ex, ey, tx, ty = (sum(p[i][j] for p in pairs) / n for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)))
    dot = sum((e[0] - ex) * (t[0] - tx) + (e[1] - ey) * (t[1] - ty) for e, t in pairs)
    cross = sum((e[0] - ex) * (t[1] - ty) - (e[1] - ey) * (t[0] - tx) for e, t in pairs)
    turn = math.atan2(cross, dot)
    c, s = math.cos(turn), math.sin(turn)
    return [(tx + c * (e[0] - ex) - s * (e[1] - ey), ty + s * (e[0] - ex) + c * (e[1] - ey), e[2] + turn)
            for e in (poses or [e for e, _ in pairs])]


def rmse(pairs):
    """(position in m, heading in rad) after moving the estimate onto the truth. pairs: [(estimate, truth)]"""
    position = heading = 0.0
    for estimate, (_, truth) in zip(moved(pairs), pairs):
        position += (estimate[0] - truth[0]) ** 2 + (estimate[1] - truth[1]) ** 2
        heading += wrap(estimate[2] - truth[2]) ** 2
    return math.sqrt(position / len(pairs)), math.sqrt(heading / len(pairs))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("estimate", help="TUM file")
    parser.add_argument("truth", help="TUM file")
    parser.add_argument("--max-gap", type=float, default=0.2, metavar="S",
                        help="longest gap in the truth that is interpolated (default 0.2 s)")
    arguments = parser.parse_args()
    try:
        estimate, truth = read_tum(arguments.estimate), read_tum(arguments.truth)
    except (OSError, UnicodeDecodeError) as error:
        sys.exit(f"trajectory_error: {error}")
    stamps = [pose[0] for pose in truth]
    matched = [(pose[1:], interpolate(truth, stamps, pose[0], arguments.max_gap)) for pose in estimate]
    pairs = [(e, t) for e, t in matched if t is not None]
    if len(pairs) < 2:
        sys.exit("trajectory_error: fewer than two poses have a true one at their stamp; are both of the same drive?")
    position_m, heading_rad = rmse(pairs)
    print(f"RMSE {100.0 * position_m:.2f} cm, heading {math.degrees(heading_rad):.3f} deg "
          f"({len(pairs)} of {len(estimate)} poses)")


if __name__ == "__main__":
    main()
