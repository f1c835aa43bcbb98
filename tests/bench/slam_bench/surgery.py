"""Accidents: takes a simulated CARMEN log and its truth, and lets something happen in the middle.

    kidnap GAP_S    the cart is lifted and put down where it will be later on: scans in between are cut out, and time
                    goes on GAP_S later
    carried         the same, but it is carried there blindly: the scanner sees nothing for 5 s
    blind SECONDS   no beam returns
    lost SECONDS    no scan arrives
    crowd SECONDS   people stand and shuffle around the cart and go along with it, half of all beams or more end at them

The instant is the first after 40 % of the run at which the cart moves. Whether a run recovered is judged by its two
parts: each alone, and both together in one frame.
"""
import json
import math
import random

from . import metrics

CARRIED_S = 5.0
KIDNAP_M = 8.0       # at least so far away it is put down
MOVING_M_S = 0.5
RECOVERED_M = 0.03   # RMSE
PERSON_M = 0.25      # radius


def operate(operation, folder, seed, *arguments):
    """Changes log.clf and truth.tum of the folder, and writes notes.json."""
    truth = metrics.read_tum(folder / "truth.tum")
    begin = moving_from(truth, 0.4)
    begin_s = truth[begin][0]
    random_numbers = random.Random(f"{operation} {seed}")
    gap_s = 0.0
    change = None
    if operation in ("kidnap", "carried"):
        gap_s = CARRIED_S if operation == "carried" else float(arguments[0])
        end_s = truth[put_down(truth, begin)][0]
    else:
        end_s = begin_s + float(arguments[0])
        if operation == "blind":
            change = lambda ranges, *_: ["0"] * len(ranges)
        elif operation == "crowd":
            change = Crowd(random_numbers).hide
        elif operation != "lost":
            raise ValueError(f"no such operation: {operation}")
    # What is cut out of time, but for the gap.
    cut_s = end_s - begin_s - gap_s if operation in ("kidnap", "carried") else 0.0
    keep = operation in ("blind", "crowd")
    with (open(folder / "log.clf", encoding="ascii") as source,
          open(folder / "operated", "w", encoding="ascii") as target):
        for line in source:
            if not line.startswith("ROBOTLASER1"):
                target.write(line)
                continue
            fields = line.split()
            stamp = float(fields[-1])
            if operation == "carried" and begin_s <= stamp < begin_s + CARRIED_S:
                target.write(" ".join(changed(fields, ["0"] * int(fields[8]))) + "\n")
            elif begin_s <= stamp < end_s:
                if keep:
                    n = int(fields[8])
                    target.write(" ".join(changed(fields, change(fields[9:9 + n], float(fields[2]), float(fields[4]),
                                                                  stamp - begin_s))) + "\n")
            else:
                if stamp >= end_s:
                    fields[-1] = fields[-3] = f"{stamp - cut_s:.6f}"
                target.write(" ".join(fields) + "\n")
    (folder / "operated").replace(folder / "log.clf")
    kept = [p for p in truth if p[0] < begin_s or p[0] >= end_s or keep]
    with open(folder / "truth.tum", "w", encoding="ascii") as target:
        for stamp, x, y, yaw in kept:
            stamp -= cut_s if stamp >= end_s else 0.0
            target.write(f"{stamp:.6f} {x:.9f} {y:.9f} 0 0 0 {math.sin(yaw / 2):.12f} {math.cos(yaw / 2):.12f}\n")
    (folder / "notes.json").write_text(json.dumps(
        {"operation": operation, "begin_s": begin_s, "end_s": end_s - cut_s, "start_s": truth[0][0],
         "from": truth[begin][1:3], "to": [p for p in truth if p[0] >= end_s][0][1:3]}))


def changed(fields, ranges):
    return fields[:9] + ranges + fields[9 + len(ranges):]


def moving_from(truth, share):
    """Index of the first pose after this share of the run from which on the cart moves."""
    i = int(share * len(truth))
    while i + 40 < len(truth):
        (t0, x0, y0, _), (t1, x1, y1, _) = truth[i], truth[i + 40]
        if math.hypot(x1 - x0, y1 - y0) > MOVING_M_S * (t1 - t0):
            return i
        i += 1
    return int(share * len(truth))


def put_down(truth, begin):
    """Index of the first pose far enough from the one at `begin`, at least a few seconds later."""
    x0, y0 = truth[begin][1:3]
    for i in range(begin + int(CARRIED_S / 0.025) + 1, len(truth)):
        if math.hypot(truth[i][1] - x0, truth[i][2] - y0) > KIDNAP_M:
            return i
    raise ValueError("the run is too short to be kidnapped")


class Crowd:
    """Discs about the sensor that take hold of the beams; each keeps its place within some decimetres."""

    def __init__(self, numbers, people=12):
        self.people = [(numbers.uniform(-math.pi, math.pi), numbers.uniform(0.6, 1.6), numbers.uniform(0.0, 7.0),
                        numbers.uniform(0.5, 1.5)) for _ in range(people)]
        self.numbers = numbers

    def hide(self, ranges, first, step, age_s):
        """The ranges with people in front; the first beam's direction and the step in rad."""
        shown = list(ranges)
        for direction, distance, phase, pace in self.people:
            direction += 0.15 * math.sin(pace * age_s + phase)
            distance += 0.2 * math.sin(0.7 * pace * age_s + 2.0 * phase)
            half = math.asin(PERSON_M / distance)
            low = max(0, math.ceil((direction - half - first) / step))
            high = min(len(ranges) - 1, math.floor((direction + half - first) / step))
            for beam in range(low, high + 1):
                off = first + beam * step - direction
                reach = distance * math.cos(off) - math.sqrt(max(0.0, PERSON_M ** 2 - (distance * math.sin(off)) ** 2))
                reach += self.numbers.gauss(0.0, 0.01)
                if not 0.0 < float(shown[beam]) <= reach:
                    shown[beam] = f"{reach:.3f}"
        return shown


def score_parts(estimate, truth, notes):
    """Figures of the whole in one frame, and of what lies before and after the accident each in its own."""
    before = [p for p in estimate if p[0] < notes["begin_s"]]
    after = [p for p in estimate if p[0] >= notes["end_s"]]
    whole = metrics.against_truth(before + after, truth) or {}
    parts = [metrics.against_truth(part, truth) for part in (before, after)]
    parts_m = [part["rmse_m"] if part else None for part in parts]
    together = whole.get("rmse_m") is not None and whole["rmse_m"] <= RECOVERED_M
    apart = all(m is not None and m <= RECOVERED_M for m in parts_m)
    return {**whole, "parts_rmse_m": parts_m, "recovered": together, "parts_whole": apart,
            "accident_at_s": notes["begin_s"] - notes["start_s"]}
