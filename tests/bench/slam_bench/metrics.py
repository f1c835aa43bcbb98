"""How wrong a run is: against the exact truth of a simulated log, or against reference relations.

Poses are (x_m, y_m, yaw_rad), trajectories [(stamp_s, x_m, y_m, yaw_rad)] sorted by stamp. Pure functions.
"""
import bisect
import math
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[3] / "tools"))
from trajectory_error import interpolate, moved, read_tum, wrap  # pylint: disable=wrong-import-position

__all__ = ["against_relations", "against_truth", "between", "compose", "end_against_truth", "loops_against_truth", "moved",
           "pose_at", "read_relations", "read_tum", "slips", "spearman", "wrap"]

LONGEST_GAP_S = 1.0   # of the truth that is interpolated over
SLICES = 20           # of the run's time, each with its RMSE: where it goes wrong
FALSE_LOOP_M = 0.3
FALSE_LOOP_RAD = math.radians(2.0)


def between(a, b):
    """Pose b seen from pose a."""
    c, s = math.cos(a[2]), math.sin(a[2])
    dx, dy = b[0] - a[0], b[1] - a[1]
    return c * dx + s * dy, -s * dx + c * dy, wrap(b[2] - a[2])


def compose(a, b):
    """Pose a followed by the motion b, given in a's frame."""
    c, s = math.cos(a[2]), math.sin(a[2])
    return a[0] + c * b[0] - s * b[1], a[1] + s * b[0] + c * b[1], wrap(a[2] + b[2])


def with_truth(estimate, truth):
    """[(stamp_s, estimated pose, true pose)] where the truth is known."""
    stamps = [pose[0] for pose in truth]
    found = ((p[0], p[1:], interpolate(truth, stamps, p[0], LONGEST_GAP_S)) for p in estimate)
    return [(stamp, e, t) for stamp, e, t in found if t is not None]


def size(points):
    """Root mean square distance of points to their centre."""
    n = len(points)
    x, y = sum(p[0] for p in points) / n, sum(p[1] for p in points) / n
    return math.sqrt(sum((p[0] - x) ** 2 + (p[1] - y) ** 2 for p in points) / n)


def against_truth(estimate, truth):
    """Figures after the best rigid alignment; the scale is that of a similarity fitted apart. None: nothing matches."""
    matched = with_truth(estimate, truth)
    if len(matched) < 2:
        return None
    pairs = [(e, t) for _, e, t in matched]
    aligned = moved(pairs)
    errors = [math.hypot(a[0] - t[0], a[1] - t[1]) for a, (_, t) in zip(aligned, pairs)]
    headings = [wrap(a[2] - t[2]) for a, (_, t) in zip(aligned, pairs)]
    n = len(errors)
    worst = max(range(n), key=errors.__getitem__)
    tx, ty = sum(t[0] for _, t in pairs) / n, sum(t[1] for _, t in pairs) / n
    # Aligned, both centres coincide: the best scale is <e, t> / <e, e>, the error of the estimate's size its inverse.
    dot = sum((a[0] - tx) * (t[0] - tx) + (a[1] - ty) * (t[1] - ty) for a, (_, t) in zip(aligned, pairs))
    own = sum((a[0] - tx) ** 2 + (a[1] - ty) ** 2 for a in aligned)
    begin, end = matched[0][0], matched[-1][0]
    sums = [[0.0, 0] for _ in range(SLICES)]
    for (stamp, _, _), error in zip(matched, errors):
        one = sums[min(SLICES - 1, int(SLICES * (stamp - begin) / max(1e-9, end - begin)))]
        one[0] += error * error
        one[1] += 1
    return {
        "poses": len(estimate), "matched": n,
        "coverage": sum(min(b[0] - a[0], LONGEST_GAP_S) for a, b in zip(matched, matched[1:])) /
                    max(1e-9, truth[-1][0] - truth[0][0]),
        "rmse_m": math.sqrt(sum(e * e for e in errors) / n),
        "worst_m": errors[worst],
        "worst_at_s": matched[worst][0] - truth[0][0],
        "worst_at_m": [round(v, 2) for v in pairs[worst][1][:2]],
        "heading_rad": math.sqrt(sum(h * h for h in headings) / n),
        "scale_error": own / dot - 1.0 if dot > 0.0 and size([t for _, t in pairs]) > 0.1 else None,
        "length_error": length_error(pairs),
        "rmse_slices_m": [round(math.sqrt(s / k), 5) if k else None for s, k in sums],
    }


def length_error(pairs):
    """(distance from first to last pose / true one - 1): what a corridor gained or lost."""
    (e0, t0), (e1, t1) = pairs[0], pairs[-1]
    true_m = math.hypot(t1[0] - t0[0], t1[1] - t0[1])
    return math.hypot(e1[0] - e0[0], e1[1] - e0[1]) / true_m - 1.0 if true_m > 1.0 else None


def slips(estimate, truth, most=5):
    """Where tracking slips, in words, worst first: stretches of steps of 0.2 s that are each off by 8 mm or 0.25 deg.

    For the filter's trajectory: what the graph mends later is still seen. A single step is the graph's correction.
    """
    matched = with_truth(estimate, truth)
    step = 8
    groups = []
    for i in range(0, len(matched) - step, step):
        off = between(between(matched[i][2], matched[i + step][2]), between(matched[i][1], matched[i + step][1]))
        if math.hypot(off[0], off[1]) > 0.008 or abs(off[2]) > 0.0044:
            if groups and i - groups[-1][1] <= 5 * step:
                groups[-1][1] = i + step
            else:
                groups.append([i, i + step])
    found = []
    for i, j in groups:
        true = between(matched[i][2], matched[j][2])
        off = between(true, between(matched[i][1], matched[j][1]))
        x, y, yaw = matched[i][2]
        found.append((math.hypot(off[0], off[1]) + 10.0 * abs(off[2]),
                      f"{matched[i][0] - truth[0][0]:.1f} to {matched[j][0] - truth[0][0]:.1f} s: {off[0]:+.3f} m, "
                      f"{off[1]:+.3f} m, {math.degrees(off[2]):+.2f} deg on a true way of "
                      f"{true[0]:.1f}, {true[1]:.1f} m, {math.degrees(true[2]):.0f} deg from "
                      f"({x:.1f}, {y:.1f}; {math.degrees(yaw):.0f} deg)"))
    found.sort(reverse=True)
    return [words for _, words in found[:most]]


def read_relations(path):
    """[(from_s, to_s, pose of to seen from from)] of lines "t1 t2 x y z roll pitch yaw"."""
    relations = []
    for line in pathlib.Path(path).read_text(encoding="ascii").splitlines():
        fields = line.split("#")[0].split()
        if fields:
            t1, t2, x, y, _, _, _, yaw = map(float, fields)
            relations.append((t1, t2, (x, y, yaw)))
    return relations


def pose_at(poses, stamps, stamp, tolerance_s=0.005, longest_gap_s=2.0):
    """Pose within the tolerance of the stamp, else interpolated over a gap that is not too long, else None."""
    after = bisect.bisect_left(stamps, stamp)
    near = [i for i in (after - 1, after) if 0 <= i < len(poses) and abs(stamps[i] - stamp) <= tolerance_s]
    if near:
        return poses[min(near, key=lambda i: abs(stamps[i] - stamp))][1:]
    return interpolate(poses, stamps, stamp, longest_gap_s)


def against_relations(estimate, relations):
    """Mean errors of the motions between pairs of stamps (Kuemmerle et al., Autonomous Robots 27(4), 2009)."""
    stamps = [pose[0] for pose in estimate]
    errors = []
    for from_s, to_s, wanted in relations:
        a, b = pose_at(estimate, stamps, from_s), pose_at(estimate, stamps, to_s)
        if a is not None and b is not None:
            off = between(wanted, between(a, b))
            errors.append((math.hypot(off[0], off[1]), abs(off[2]), from_s, to_s))
    if not errors:
        return None
    n = len(errors)
    worst = max(errors)
    start = estimate[0][0]
    return {"relations": len(relations), "matched": n,
            "mean_m": sum(e[0] for e in errors) / n, "mean_rad": sum(e[1] for e in errors) / n,
            "median_m": sorted(e[0] for e in errors)[n // 2], "worst_m": worst[0],
            "worst_at_s": [round(worst[2] - start, 1), round(worst[3] - start, 1)],
            "poses": len(estimate)}


def mahalanobis2(v, upper):
    """v' C^-1 v for a symmetric 3 x 3 C given as its upper triangle, None if it is singular."""
    a, b, c, d, e, f = upper
    cofactors = (d * f - e * e, c * e - b * f, b * e - c * d, a * f - c * c, b * c - a * e, a * d - b * b)
    determinant = a * cofactors[0] + b * cofactors[1] + c * cofactors[2]
    if determinant <= 0.0:
        return None
    p, q, r, s, t, u = cofactors
    x, y, z = v
    return (p * x * x + s * y * y + u * z * z + 2.0 * (q * x * y + r * x * z + t * y * z)) / determinant


def loops_against_truth(report, truth):
    """Confirmed loops of a report.json that are not true, and whether the stated covariances hold (NEES, 3 dof)."""
    stamps = [pose[0] for pose in truth]
    origin = {s["index"]: pose_at(truth, stamps, s["begun_us"] * 1e-6) for s in report["submaps"] if "begun_us" in s}

    def off_truth(pair):
        a, b = origin.get(pair["a"]), origin.get(pair["b"])
        if a is None or b is None:
            return None
        true, said = between(a, b), pair["a_from_b"]
        return said[0] - true[0], said[1] - true[1], wrap(said[2] - true[2])
    links = ((off_truth(link), link["covariance"]) for link in report.get("links", ()))
    link_nees = [n for off, upper in links if off is not None and (n := mahalanobis2(off, upper)) is not None]
    false, nees, off_m = [], [], []
    for match in report["matches"]:
        off = off_truth(match)
        if off is None:
            continue
        distance = math.hypot(off[0], off[1])
        off_m.append(distance)
        if distance > FALSE_LOOP_M or abs(off[2]) > FALSE_LOOP_RAD:
            false.append([match["a"], match["b"], round(distance, 3), round(abs(off[2]), 4)])
        elif (squared := mahalanobis2(off, match["covariance"])) is not None:
            nees.append(squared)
    submaps = [s for s in report["submaps"] if origin.get(s["index"]) is not None and "covariance_bound" in s]
    bound_nees = []
    for submap in submaps[1:]:
        first = submaps[0]
        # Relative to the first sub-map, turned into the map's axes as the bound is.
        said, true = between(first["pose"], submap["pose"]), between(origin[first["index"]], origin[submap["index"]])
        c, s = math.cos(first["pose"][2]), math.sin(first["pose"][2])
        dx, dy = said[0] - true[0], said[1] - true[1]
        squared = mahalanobis2((c * dx - s * dy, s * dx + c * dy, wrap(said[2] - true[2])), submap["covariance_bound"])
        if squared is not None:
            bound_nees.append(squared)
    return {"loops": len(off_m), "false_loops": false, "loop_worst_m": max(off_m, default=0.0),
            "match_nees": mean(nees), "link_nees": mean(link_nees), "bound_nees": mean(bound_nees)}


def end_against_truth(report, truth):
    """How far the run's end is from its start, too much by so much, and the sigma of it that the report states."""
    submaps, end = report["submaps"], report.get("end")
    if end is None or "begun_us" not in submaps[0]:
        return {}
    stamps = [pose[0] for pose in truth]
    start, said = submaps[0]["pose"], end["pose"]
    true_start, true_end = (pose_at(truth, stamps, stamp * 1e-6) for stamp in (submaps[0]["begun_us"], end["stamp_us"]))
    length_m = math.dist(start[:2], said[:2])
    if true_start is None or true_end is None or length_m == 0.0:
        return {}
    x, y = (said[0] - start[0]) / length_m, (said[1] - start[1]) / length_m
    xx, xy, _, yy, _, _ = end["covariance_bound"]
    return {"end_off_m": length_m - math.dist(true_start[:2], true_end[:2]),
            "end_sigma_m": math.sqrt(max(0.0, x * x * xx + 2.0 * x * y * xy + y * y * yy))}


def mean(values):
    return sum(values) / len(values) if values else None


def ranks(values):
    """Ranks from 1; equal values share the mean of theirs."""
    order = sorted(range(len(values)), key=values.__getitem__)
    result = [0.0] * len(values)
    i = 0
    while i < len(order):
        j = i
        while j + 1 < len(order) and values[order[j + 1]] == values[order[i]]:
            j += 1
        for k in range(i, j + 1):
            result[order[k]] = (i + j) / 2 + 1
        i = j + 1
    return result


def spearman(xs, ys):
    """Rank correlation from -1 to 1; None with fewer than three pairs or no variation."""
    if len(xs) < 3:
        return None
    a, b = ranks(xs), ranks(ys)
    middle = (len(a) + 1) / 2
    top = sum((p - middle) * (q - middle) for p, q in zip(a, b))
    low = math.sqrt(sum((p - middle) ** 2 for p in a) * sum((q - middle) ** 2 for q in b))
    return top / low if low > 0.0 else None
