#!/usr/bin/env python3
"""tests/bench/slam: its metrics on what is known, and a killed command that goes on.

Usage: slam_bench_test.py BENCH SUBMAPCTL
"""
import json
import math
import os
import pathlib
import random
import struct
import subprocess
import sys
import tempfile
import unittest

BENCH, SUBMAPCTL = map(pathlib.Path, sys.argv[1:3])
del sys.argv[1:3]
sys.dont_write_bytecode = True
sys.path.insert(0, str(BENCH.parent))
from slam_bench import carmen_sparse, metrics, page, rows, surgery  # pylint: disable=wrong-import-position


def drive(n=400):
    """Half a circle of 10 m radius and some of it back, 40 poses a second."""
    angles = [0.01 * min(i, 600 - i) for i in range(n)]
    return [(0.025 * i, 10 * math.cos(a), 10 * math.sin(a), metrics.wrap(a + math.pi / 2))
            for i, a in enumerate(angles)]


def elsewhere(poses, place):
    return [(t, *metrics.compose(place, pose)) for t, *pose in poses]


class MetricsTest(unittest.TestCase):
    def test_a_rigid_motion_is_no_error(self):
        score = metrics.against_truth(elsewhere(drive(), (3.0, -70.0, 2.5)), drive())
        self.assertEqual(score["matched"], 400)
        for key in ("rmse_m", "worst_m", "heading_rad", "scale_error", "length_error"):
            self.assertAlmostEqual(score[key], 0.0, places=9, msg=key)
        self.assertEqual(metrics.slips(elsewhere(drive(), (3.0, -70.0, 2.5)), drive()), [])

    def test_scale_is_told_apart_from_noise(self):
        stretched = [(t, 1.002 * x, 1.002 * y, yaw) for t, x, y, yaw in drive()]
        score = metrics.against_truth(elsewhere(stretched, (1.0, 2.0, 3.0)), drive())
        self.assertAlmostEqual(score["scale_error"], 0.002, places=6)
        self.assertAlmostEqual(score["length_error"], 0.002, places=6)

    def test_the_worst_point_and_the_slip_are_where_they_are(self):
        truth = drive()
        bad = list(truth)
        bad[200] = (bad[200][0], bad[200][1] + 0.5, *bad[200][2:])
        score = metrics.against_truth(bad, truth)
        self.assertAlmostEqual(score["worst_m"], 0.5, delta=0.01)
        self.assertAlmostEqual(score["worst_at_s"], 5.0)
        slipped = truth[:200] + elsewhere(truth[200:], (0.0, 0.0, 0.0))
        slipped[200:] = [(t, x + 0.3, y, yaw) for t, x, y, yaw in slipped[200:]]
        found = metrics.slips(slipped, truth)
        self.assertEqual(len(found), 1)
        self.assertTrue(found[0].startswith(("4.8 to 5.0 s", "5.0 to 5.2 s")), found)

    def test_relations_are_taken_in_the_robots_frame(self):
        truth = drive()
        relations = [(truth[i][0], truth[i + 50][0], metrics.between(truth[i][1:], truth[i + 50][1:]))
                     for i in range(0, 300, 10)]
        score = metrics.against_relations(elsewhere(truth, (5.0, 5.0, 1.0)), relations)
        self.assertEqual((score["matched"], round(score["mean_m"], 9)), (30, 0.0))
        off = [(a, b, metrics.compose(pose, (0.03, 0.04, 0.01))) for a, b, pose in relations]
        score = metrics.against_relations(truth, off + [(1e6, 2e6, (0.0, 0.0, 0.0))])
        self.assertEqual((score["relations"], score["matched"]), (31, 30))
        self.assertAlmostEqual(score["mean_m"], 0.05, places=9)
        self.assertAlmostEqual(score["mean_rad"], 0.01, places=9)

    def test_false_loops_are_seen_and_covariances_judged(self):
        truth = drive()
        numbers = random.Random(1)
        sigma = (0.02, 0.01, 0.003)
        upper = [sigma[0] ** 2, 0, 0, sigma[1] ** 2, 0, sigma[2] ** 2]
        stamps = list(range(0, 400, 2))
        submaps = [{"index": k, "begun_us": round(truth[i][0] * 1e6), "pose": truth[i][1:], "covariance_bound": upper}
                   for k, i in enumerate(stamps)]
        matches = []
        for k in range(1, 200):
            true = metrics.between(truth[stamps[0]][1:], truth[stamps[k]][1:])
            noisy = tuple(v + numbers.gauss(0.0, s) for v, s in zip(true, sigma))
            matches.append({"a": 0, "b": k, "a_from_b": noisy, "covariance": upper})
        matches[7]["a_from_b"] = (matches[7]["a_from_b"][0] + 1.0, *matches[7]["a_from_b"][1:])
        score = metrics.loops_against_truth({"submaps": submaps, "matches": matches}, truth)
        self.assertEqual([loop[:2] for loop in score["false_loops"]], [[0, 8]])
        self.assertAlmostEqual(score["match_nees"], 3.0, delta=0.6)
        self.assertAlmostEqual(score["bound_nees"], 0.0, places=6)
        self.assertIsNone(score["link_nees"])
        score = metrics.loops_against_truth({"submaps": submaps, "matches": [], "links": matches[:7]}, truth)
        self.assertAlmostEqual(score["link_nees"], 3.0, delta=2.0)

    def test_the_end_is_judged_along_the_way_to_it(self):
        truth = [(0.025 * i, 2.0, 0.05 * i, 0.0) for i in range(401)]  # 20 m along y
        said = {"submaps": [{"index": 0, "begun_us": 0, "pose": (7.0, 0.0, 0.0)}],
                "end": {"stamp_us": 10_000_000, "pose": (7.0 - 12.6, 16.8, 0.0),
                        "covariance_bound": [0.09, 0.0, 0.0, 0.04, 0.0, 1.0]}}
        score = metrics.end_against_truth(said, truth)
        self.assertAlmostEqual(score["end_off_m"], 1.0, places=6)
        self.assertAlmostEqual(score["end_sigma_m"], math.hypot(0.6 * 0.3, 0.8 * 0.2), places=6)
        self.assertEqual(metrics.end_against_truth({"submaps": said["submaps"]}, truth), {})

    def test_a_figure_over_all_seeds_is_one_value(self):
        figure = rows.Figure("share", lambda seeds: sum(seeds) / len(seeds), 0.5, at_least=True, over_all=True)
        row = rows.Row("r", "", None, (figure,), seeds=3)
        line, = page.lines_of(row, {1: 0.0, 2: 1.0}, "not run")
        self.assertEqual(line.cells[1:], ("share", "0.50", "0.50", "≥ 0.5", "", "met so far", "2 of 3"))

    def test_rank_correlation(self):
        self.assertAlmostEqual(metrics.spearman([1, 2, 3, 4], [10, 100, 1000, 1e6]), 1.0)
        self.assertAlmostEqual(metrics.spearman([1, 2, 3, 4], [4, 3, 2, 1]), -1.0)
        self.assertAlmostEqual(metrics.spearman([1, 1, 2], [1, 2, 3]), math.sqrt(3) / 2)
        self.assertIsNone(metrics.spearman([1, 1, 1], [1, 2, 3]))


class SparseTest(unittest.TestCase):
    def test_made_odometry_drifts_but_not_between_neighbours(self):
        poses = [pose for _, *pose in drive()]
        poses = poses[::10] * 5
        odometry = carmen_sparse.drifted(poses, 1)
        self.assertEqual(odometry, carmen_sparse.drifted(poses, 1))
        self.assertNotEqual(odometry, carmen_sparse.drifted(poses, 2))
        steps = [metrics.between(metrics.between(a, b), metrics.between(c, d))
                 for a, b, c, d in zip(poses, poses[1:], odometry, odometry[1:])]
        self.assertLess(sum(math.hypot(x, y) for x, y, _ in steps) / len(steps), 0.2)
        self.assertGreater(math.dist(odometry[-1][:2], poses[-1][:2]), 0.2)

    def test_a_submap_file_is_read(self):
        keyframe = struct.pack("<Qqddd", 7, 1_500_000, 0.5, -0.25, 0.1) + bytes(24 + 72 + 1 + 40 + 24)
        keyframe += struct.pack("<I", 3) + bytes(6)
        seen = bytearray(4096)
        for row in range(8, 16):  # one coarse cell whole, the next one by a quarter
            seen[64 * row:64 * row + 10] = bytes([200]) * 10
        sections = [bytes(32) + struct.pack("<I", 5) + bytes(25) + struct.pack("<d?", 0.05, True),
                    struct.pack("<I", 2) + keyframe + keyframe,
                    struct.pack("<I", 2) + struct.pack("<ii", -1, 2) + seen + struct.pack("<ii", 0, 2) + bytes(4096),
                    struct.pack("<I", 0)]
        body = b"".join(struct.pack("<IIQ", n, 0, len(s)) + s for n, s in enumerate(sections, 1))
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder, "000005.submap")
            path.write_bytes(struct.pack("<8sIIQ", b"SUBMAPD\n", 1, 4, 24 + len(body) + 4) + body + bytes(4))
            index, keyframes, cell_m, known = carmen_sparse.read_submap(path)
        self.assertEqual((index, cell_m, known), (5, 0.05, [(-8, 17)]))
        self.assertEqual(keyframes, [(1.5, 0.5, -0.25, 0.1)] * 2)

    def test_closed_pairs_are_judged_by_the_reference(self):
        truth = drive()
        square = [(x, y) for x in range(-8, 8) for y in range(-8, 8)]  # 41 m2 in cells of 0.4 m
        submaps, places = [], []
        for index, first in enumerate((0, 7, 14, 21, 28)):
            place = truth[first][1:]
            places.append(place)
            keyframes = [(t, *metrics.between(place, pose)) for t, *pose in truth[first:first + 40:4]]
            submaps.append({"index": index, "keyframes": keyframes, "cell_m": 0.4, "known": square})
        report = {"submaps": [{"index": i, "pose": p} for i, p in enumerate(places)],
                  "matches": [{"a": 0, "b": 3, "a_from_b": metrics.between(places[0], places[3])},
                              {"a": 0, "b": 2, "a_from_b": (9.0, 9.0, 0.0)}]}
        score = carmen_sparse.score_pairs(truth, truth, submaps, report)
        # 2.1 m apart 0 and 3 overlap by more than 25 m2, as 1 and 4 do; 0 and 4, 2.8 m apart, do not.
        self.assertEqual((score["closed"], score["wrong"], score["loops"]), (1, [], 1))
        self.assertEqual(score["recall"], 1.0 / score["overlapping"])
        report["matches"][0]["a_from_b"] = metrics.compose(report["matches"][0]["a_from_b"], (0.4, 0.0, 0.0))
        wrong = carmen_sparse.score_pairs(truth, truth, submaps, report)["wrong"]
        self.assertEqual([(w["a"], w["b"], w["match_m"], w["map_m"]) for w in wrong], [(0, 3, 0.4, 0.0)])


class SurgeryTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.truth = [(0.025 * i, 0.05 * i, 0.0, 0.0) for i in range(1000)]  # 25 s at 2 m/s

    def operate(self, *operation):
        ranges = " ".join(["5.000"] * 109)
        with open(self.folder / "log.clf", "w", encoding="ascii") as log:
            for t, *_ in self.truth:
                log.write(f"ROBOTLASER1 3 -2.356194 4.712389 0.043633 30 0.01 0 109 {ranges} 0 0 0 0 0 0 0 0 0 0 0 0 "
                          f"{t:.6f} sim {t:.6f}\n")
        (self.folder / "truth.tum").write_text("".join(f"{t:.6f} {x} {y} 0 0 0 0 1\n" for t, x, y, _ in self.truth))
        surgery.operate(operation[0], self.folder, 1, *operation[1:])
        scans = [line.split() for line in (self.folder / "log.clf").read_text().splitlines()]
        truth = metrics.read_tum(self.folder / "truth.tum")
        notes = json.loads((self.folder / "notes.json").read_text())
        return [(float(s[-1]), list(map(float, s[9:9 + 109]))) for s in scans], truth, notes

    def test_a_kidnapped_cart_goes_on_elsewhere_without_a_pause(self):
        scans, truth, notes = self.operate("kidnap", "0")
        self.assertEqual([s for s, _ in scans], [p[0] for p in truth])
        self.assertLess(max(b[0] - a[0] for a, b in zip(scans, scans[1:])), 0.03)
        jumps = [b[1] - a[1] for a, b in zip(truth, truth[1:]) if b[1] - a[1] > 0.1]
        self.assertEqual(len(jumps), 1)
        self.assertGreater(jumps[0], surgery.KIDNAP_M)
        self.assertTrue(surgery.score_parts(truth, truth, notes)["recovered"])
        ignored = [p if p[0] < notes["begin_s"] else (p[0], p[1] - jumps[0], *p[2:]) for p in truth]
        score = surgery.score_parts(ignored, truth, notes)
        self.assertEqual((score["recovered"], score["parts_whole"]), (False, True))

    def test_what_is_hidden_is_hidden_and_nothing_else(self):
        scans, truth, notes = self.operate("blind", "2")
        self.assertEqual((len(scans), len(truth)), (1000, 1000))
        dark = [t for t, ranges in scans if max(ranges) == 0.0]
        self.assertEqual((len(dark), round(dark[0], 3)), (80, notes["begin_s"]))
        scans, truth, _ = self.operate("lost", "2")
        self.assertEqual((len(scans), len(truth)), (920, 920))
        scans, _, notes = self.operate("crowd", "10")
        hidden = [sum(r < 2.5 for r in ranges) / len(ranges) for t, ranges in scans
                  if notes["begin_s"] <= t < notes["end_s"]]
        self.assertEqual(len(hidden), 400)
        self.assertGreater(min(hidden), 0.35)
        self.assertLess(max(hidden), 0.95)
        self.assertEqual(sum(min(ranges) < 4.9 for _, ranges in scans), 400)


class PageTest(unittest.TestCase):
    def test_rows_that_were_not_run_stay_and_order_holds(self):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder, "README.md")
            path.write_text("before\n<!-- t: begin -->\n| h |\n|---|\n| `b` | old |\n|  | second |\n| `c` | old |\n"
                            "<!-- t: end -->\nafter\n")
            page.rewrite(path, "t", {"c": ["| `c` | new |"], "a": ["| `a` | new |"]}, ["a", "b", "c", "d"], "| h | i |",
                         {"a": ["| `a` | none |"], "b": ["| `b` | none |"], "d": ["| `d` | none |"]})
            self.assertEqual(path.read_text(), "before\n<!-- t: begin -->\n| h | i |\n|---|---|\n| `a` | new |\n"
                             "| `b` | old |\n|  | second |\n| `c` | new |\n| `d` | none |\n<!-- t: end -->\nafter\n")


class CommandTest(unittest.TestCase):
    """The whole command on a few seconds of office. Its program is ours: it notes what it is called for."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.program = self.folder / "program"
        self.program.write_text(f"""#!/bin/sh
echo "$1 $*" >> {self.folder}/calls
if [ "$1" = replay ] && [ -e {self.folder}/kill ]; then rm {self.folder}/kill; kill -KILL $PPID; fi
exec {SUBMAPCTL.resolve()} "$@"
""")
        self.program.chmod(0o755)

    def slam(self, *options):
        (self.folder / "calls").write_text("")
        result = subprocess.run([BENCH, "--submapctl", self.program, "--cache", self.folder / "cache", *options],
                                capture_output=True, text=True, check=False,
                                env={k: v for k, v in os.environ.items() if k != "SUBMAPD_DATA"})
        calls = (self.folder / "calls").read_text().splitlines()
        return result, [word for word in ("simulate", "replay") for call in calls
                        if call.startswith(f"{word} ") and "/dev/null" not in call and "--help" not in call]

    def test_killed_in_the_middle_it_goes_on_and_what_is_done_is_not_done_again(self):
        wanted = ("--rows", "office-empty,intel-used,loop-trials-columns", "--seeds", "1", "--minutes", "0.2")
        (self.folder / "kill").touch()
        result, calls = self.slam(*wanted)
        self.assertEqual((result.returncode, calls), (-9, ["simulate", "replay"]), result.stderr)
        result, calls = self.slam(*wanted)
        self.assertEqual((result.returncode, calls), (0, ["replay"]), result.stderr)
        table = result.stdout
        self.assertRegex(table, r"office-empty +RMSE cm +0\.\d\d +0\.\d\d +≤ 1 +≤ 0.5 +(goal|met) so far +1 of 5")
        self.assertRegex(table, r"intel-used .*no data: SUBMAPD_DATA is not set")
        self.assertRegex(table, r"loop-trials-columns .*not built: bench_loop_trials")
        self.assertEqual(list((self.folder / "cache" / "logs").iterdir()), [])
        self.assertTrue((self.folder / "cache" / "pictures" / "office-empty-seed-1-0.2-min.png").exists())
        result, calls = self.slam(*wanted)
        self.assertEqual((result.stdout, calls), (table, []))
        listed, calls = self.slam(*wanted, "--list")
        self.assertRegex(listed.stdout, r"office-empty .*1 of 1 runs done")

    def test_bad_usage_is_told(self):
        for words in (("--rows", "offise"), ("--seeds", "0"), ("--submapctl", "/none"), ("--readme", "--minutes", "1")):
            result, calls = self.slam(*words)
            self.assertEqual((result.returncode, calls), (2, []), words)


if __name__ == "__main__":
    unittest.main()
