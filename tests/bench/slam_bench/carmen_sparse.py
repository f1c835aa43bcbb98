"""Recorded logs with one scan a metre and corrected poses: odometry made from those poses that drifts, and the metric.

The scans are too sparse for matching without a prior, so the poses become one: each motion between two scans gets
noise like a differential drive's (that of the simulator), and a run keeps one scale error. Neighbouring scans then
drift apart by centimetres and the run by metres, as raw odometry does; the corrected poses stay the reference. Stamps
are made anew where a log has lost them or repeats them.
"""
import gzip
import json
import math
import pathlib
import random
import struct

from . import metrics

# Noise of the odometry, as OdometryOptions of tools/sim/simulator.hpp.
DISTANCE_NOISE = 0.02  # m per square root of a metre
TURN_NOISE = 0.02      # rad per square root of a radian
DRIFT = 0.003          # rad per square root of a metre
DISTANCE_SCALE = 0.01  # sigma, once a run
TURN_SCALE = 0.02

OVERLAP_M2 = 25.0
INDEX_GAP = 2          # pairs with a larger one
NEAR_M = 0.3
NEAR_RAD = math.radians(2.0)
COARSE = 8             # cells of a side of what overlap is counted in: 0.4 m
BLOCK = 64
KEYFRAME_BYTES = 8 + 8 + 3 * 8 + 3 * 8 + 9 * 8 + 1 + 5 * 8 + 3 * 8 + 4  # without its ranges


def read_scans(path):
    """[(stamp_s, pose, [range, ...] as text)] of the FLASER lines."""
    scans = []
    with gzip.open(path, "rt", encoding="ascii", errors="replace") as lines:
        for line in lines:
            fields = line.split()
            if len(fields) < 5 or fields[0] != "FLASER" or not fields[1].isdigit():
                continue
            n = int(fields[1])
            if len(fields) != n + 11:
                continue
            scans.append((float(fields[-1]), tuple(map(float, fields[n + 2:n + 5])), fields[2:n + 2]))
    return scans


def stamped(scans):
    """The same with stamps that grow: where they do not, a scan comes as much later as the cart takes at 0.5 m/s."""
    result = []
    for stamp, pose, ranges in scans:
        if result:
            last_stamp, last_pose, _ = result[-1]
            way = math.hypot(pose[0] - last_pose[0], pose[1] - last_pose[1])
            turn = abs(metrics.wrap(pose[2] - last_pose[2]))
            if not last_stamp + 0.05 < stamp < last_stamp + 300.0:
                stamp = last_stamp + max(0.2, 2.0 * way, 2.0 * turn)
        result.append((stamp, pose, ranges))
    return result


def drifted(poses, seed):
    """Odometry of a cart that drove these poses."""
    noise = random.Random(seed)
    distance_factor = 1.0 + noise.gauss(0.0, DISTANCE_SCALE)
    turn_factor = 1.0 + noise.gauss(0.0, TURN_SCALE)
    result = [poses[0]]
    for last, pose in zip(poses, poses[1:]):
        x, y, yaw = metrics.between(last, pose)
        way = math.hypot(x, y)
        sigma = DISTANCE_NOISE * math.sqrt(way)
        turn = math.hypot(TURN_NOISE * math.sqrt(abs(yaw)), DRIFT * math.sqrt(way))
        step = (distance_factor * x + noise.gauss(0.0, sigma), distance_factor * y + noise.gauss(0.0, sigma),
                turn_factor * yaw + noise.gauss(0.0, turn))
        result.append(metrics.compose(result[-1], step))
    return result


def write_drifted(source, seed, log, truth):
    """CARMEN log with drifting odometry, and the corrected poses as its truth. Unique stamps to the microsecond."""
    scans = stamped(read_scans(source))
    poses = drifted([pose for _, pose, _ in scans], seed)
    start = scans[0][0]
    with open(log, "w", encoding="ascii") as target:
        target.write(f"# odometry made of corrected poses, seed {seed}\n")
        for (stamp, _, ranges), pose in zip(scans, poses):
            where = " ".join(f"{v:.6f}" for v in pose)
            now = f"{1e9 + stamp - start:.6f}"
            target.write(f"FLASER {len(ranges)} {' '.join(ranges)} {where} {where} {now} made {now}\n")
    with open(truth, "w", encoding="ascii") as target:
        for stamp, (x, y, yaw), _ in scans:
            target.write(f"{1e9 + stamp - start:.6f} {x} {y} 0 0 0 {math.sin(yaw / 2):.12f} {math.cos(yaw / 2):.12f}\n")


# --- sub-maps -----------------------------------------------------------------------------------------------------

def read_submap(path):
    """(index, [(stamp_s, x, y, yaw) of key-frames], cell in m, [(x, y) of known coarse cells]) of a .submap file."""
    data = path.read_bytes()
    magic, version, count, _ = struct.unpack_from("<8sIIQ", data, 0)
    if magic != b"SUBMAPD\n" or version != 1:
        raise ValueError(f"{path}: not a sub-map file of version 1")
    sections, at = {}, 24
    for _ in range(count):
        number, _, length = struct.unpack_from("<IIQ", data, at)
        sections[number] = memoryview(data)[at + 16:at + 16 + length]
        at += 16 + length
    index, = struct.unpack_from("<I", sections[1], 32)
    cell_m, = struct.unpack_from("<d", sections[1], 32 + 4 + 24 + 1)
    keyframes, at = [], 4
    for _ in range(struct.unpack_from("<I", sections[2], 0)[0]):
        stamp_us, *pose = struct.unpack_from("<qddd", sections[2], at + 8)
        keyframes.append((stamp_us * 1e-6, *pose))
        beams, = struct.unpack_from("<I", sections[2], at + KEYFRAME_BYTES - 4)
        at += KEYFRAME_BYTES + 2 * beams
    known, at = set(), 4
    side = BLOCK // COARSE
    for _ in range(struct.unpack_from("<I", sections[3], 0)[0]):
        bx, by = struct.unpack_from("<ii", sections[3], at)
        cells = bytes(sections[3][at + 8:at + 8 + BLOCK * BLOCK])
        at += 8 + BLOCK * BLOCK
        if cells.count(0) == len(cells):
            continue
        for row in range(side):
            for column in range(side):
                first = COARSE * (BLOCK * row + column)
                seen = sum(COARSE - cells[first + BLOCK * i:first + BLOCK * i + COARSE].count(0) for i in range(COARSE))
                if 2 * seen >= COARSE * COARSE:
                    known.add((bx * side + column, by * side + row))
    return index, keyframes, cell_m, sorted(known)


def note_submaps(folder, target):
    """Writes what the metric needs of a folder of sub-maps: it is kept, they are not."""
    noted = []
    for path in sorted(folder.glob("*.submap")):
        index, keyframes, cell_m, known = read_submap(path)
        noted.append({"index": index, "keyframes": keyframes, "cell_m": COARSE * cell_m, "known": known})
    pathlib.Path(target).write_text(json.dumps(noted, separators=(",", ":")))


def overlap_m2(a, b, a_from_b):
    """Area known to both of two noted sub-maps if b lies there."""
    cell = a["cell_m"]
    known = a["set"]
    c, s = math.cos(a_from_b[2]), math.sin(a_from_b[2])
    count = 0
    for column, row in b["known"]:
        x, y = (column + 0.5) * cell, (row + 0.5) * cell
        place = (a_from_b[0] + c * x - s * y, a_from_b[1] + s * x + c * y)
        count += (math.floor(place[0] / cell), math.floor(place[1] / cell)) in known
    return count * cell * cell


def true_place(keyframes, truth, stamps):
    """Where the reference has a sub-map: its key-frames laid onto their reference poses, which are noisy one by one."""
    found = [(pose, metrics.pose_at(truth, stamps, stamp)) for stamp, *pose in keyframes]
    pairs = [(pose, true) for pose, true in found if true is not None]
    if not pairs:
        return None
    if len(pairs) < 3:
        return metrics.compose(pairs[0][1], metrics.between(pairs[0][0], (0.0, 0.0, 0.0)))
    place, = metrics.moved(pairs, [(0.0, 0.0, 0.0)])
    return place


def score_pairs(estimate, truth, submaps, report):
    """The issue's metric: closed pairs must lie where the reference has them; recall over all that overlap."""
    stamps = [pose[0] for pose in truth]
    for submap in submaps:
        submap["true"] = true_place(submap["keyframes"], truth, stamps)
        submap["set"] = {tuple(cell) for cell in submap["known"]}
        submap["reach"] = max((math.hypot(*cell) for cell in submap["known"]), default=0.0) * submap["cell_m"]
    by_index = {s["index"]: s for s in submaps}
    matches = {(m["a"], m["b"]): m["a_from_b"] for m in report["matches"]}
    mapped = {s["index"]: s["pose"] for s in report["submaps"]}
    overlapping = set()
    for i, a in enumerate(submaps):
        for b in submaps[i + 1:]:
            if b["index"] - a["index"] <= INDEX_GAP or a["true"] is None or b["true"] is None:
                continue
            true = metrics.between(a["true"], b["true"])
            if math.hypot(true[0], true[1]) < a["reach"] + b["reach"] and overlap_m2(a, b, true) >= OVERLAP_M2:
                overlapping.add((a["index"], b["index"]))
    closed, wrong, errors = 0, [], []
    for (i, j), match in matches.items():
        if j - i <= INDEX_GAP:
            continue
        true = metrics.between(by_index[i]["true"], by_index[j]["true"])
        off = metrics.between(true, match)
        final = metrics.between(true, metrics.between(mapped[i], mapped[j]))
        closed += (i, j) in overlapping
        distance, turn = math.hypot(off[0], off[1]), abs(off[2])
        errors.append(distance)
        if distance > NEAR_M or turn > NEAR_RAD:
            wrong.append({"a": i, "b": j, "match_m": round(distance, 3), "match_deg": round(math.degrees(turn), 2),
                          "map_m": round(math.hypot(final[0], final[1]), 3),
                          "map_deg": round(math.degrees(abs(final[2])), 2), "overlaps": (i, j) in overlapping})
    whole = metrics.against_truth(estimate, truth) or {}
    return {**whole, "submaps": len(submaps), "overlapping": len(overlapping), "closed": closed,
            "loops": len(errors), "wrong": wrong, "recall": closed / len(overlapping) if overlapping else None,
            "match_median_m": sorted(errors)[len(errors) // 2] if errors else None}
