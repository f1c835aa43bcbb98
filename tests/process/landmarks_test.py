#!/usr/bin/env python3
"""submapctl landmarks on a run whose track broke: the map is bent until a person ties its parts.
Usage: landmarks_test.py SUBMAPCTL"""
import json
import math
import pathlib
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tools"))
import trajectory_error  # noqa: E402

SUBMAPCTL = sys.argv.pop(1)
CARRIED_S = 42.0  # from the start, 15 m away: too far to be sought there again
AGAIN_S = 28.0    # so long it drives on


def submapctl(*arguments, status=0):
    result = subprocess.run([SUBMAPCTL, *map(str, arguments)], capture_output=True, text=True, check=False, timeout=300)
    assert result.returncode == status, f"{arguments}: {result.returncode}\n{result.stdout}{result.stderr}"
    return result.stdout + result.stderr


def in_frame(pose, point):
    """A place of the world in the frame of a pose (x, y, yaw)."""
    dx, dy = point[0] - pose[0], point[1] - pose[1]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return c * dx + s * dy, -s * dx + c * dy


class LandmarksTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.temporary.cleanup)
        cls.folder = pathlib.Path(cls.temporary.name)
        submapctl("simulate", "office", "--out", cls.folder / "run", "--minutes", "0.75", "--speed", "2", "--seed", "3")
        cls.truth = cls.carry_back(trajectory_error.read_tum(cls.folder / "run.truth.tum"))

    @classmethod
    def carry_back(cls, truth):
        """After 42 s the cart is put down where it started, and goes the same way again. Returns the poses."""
        header, scans = [], []
        for line in (cls.folder / "run.clf").read_text().splitlines():
            (header if line.startswith("#") else scans).append(line)
        count = sum(t[0] - truth[0][0] < CARRIED_S for t in truth)
        again = sum(t[0] - truth[0][0] < AGAIN_S for t in truth)
        later = truth[count][0] - truth[0][0]
        lines = header + scans[:count]
        for line in scans[:again]:
            words = line.split()
            words[-1] = words[-3] = f"{float(words[-1]) + later:.6f}"
            lines.append(" ".join(words))
        (cls.folder / "carried.clf").write_text("\n".join(lines) + "\n")
        return truth[:count] + [(t[0] + later, *t[1:]) for t in truth[:again]]

    def setUp(self):
        self.out = self.folder / self.id().rsplit(".", 1)[-1]
        submapctl("replay", self.folder / "carried.clf", "--out", self.out, "--no-loops")
        report = json.loads((self.out / "report.json").read_text())
        self.begun = [submap["begun_us"] * 1e-6 for submap in report["submaps"]]
        # The first sub-map after the cart was carried, and the one before it.
        self.b = next(k for k, s in enumerate(self.begun) if s - self.truth[0][0] >= CARRIED_S - 0.01)
        self.a = self.b - 1

    def landmarks(self, verb, *arguments, status=0):
        return submapctl("landmarks", verb, self.out, *arguments, "--no-loops", status=status)

    def error_m(self):
        estimate = trajectory_error.read_tum(self.out / "trajectory.tum")
        return trajectory_error.rmse([(e[1:], t[1:]) for e, t in zip(estimate, self.truth, strict=True)])[0]

    def true_points(self, shift_m=0.0):
        """Three places near b's beginning, as they truly lie in both sub-maps."""
        a, b = (trajectory_error.interpolate(self.truth, [t[0] for t in self.truth], self.begun[k], 0.2)
                for k in (self.a, self.b))
        options = []
        for place in ((b[0] + 3.0, b[1]), (b[0] - 2.0, b[1] + 2.0), (b[0], b[1] - 3.0)):
            (ax, ay), (bx, by) = in_frame(a, place), in_frame(b, place)
            options += ["--point", f"{ax + shift_m:.4f},{ay:.4f}={bx:.4f},{by:.4f}"]
        return [*options, "--frame", "submap"]

    def test_points_in_both_parts_join_them_and_undo_takes_them_apart(self):
        bent_m = self.error_m()
        self.assertRegex(self.landmarks("list"), rf"(?m)^ *{self.a} +{self.b} +not tied ")
        self.assertGreater(bent_m, 0.5, "the carried cart bends the map")
        added = self.landmarks("add", self.a, self.b, *self.true_points(), "--no-snap")
        self.assertIn("committed", added)
        self.assertIn("sub-maps move by up to", added)
        self.assertGreater(self.error_m(), 0.5, "the map on the disk is as it was until it is solved")
        self.landmarks("solve")
        tied_m = self.error_m()
        self.assertLess(tied_m, 0.2)
        self.assertIn("edit: tie of sub-maps", self.landmarks("list"))
        self.assertIn("undone", self.landmarks("undo"))
        self.landmarks("solve")
        self.assertAlmostEqual(self.error_m(), bent_m, delta=1e-6)
        self.landmarks("undo", status=1)
        self.assertIn("0 problems", submapctl("verify", self.out))
        print(f"\nRMSE {bent_m:.3f} m bent, {tied_m:.3f} m tied")

    def test_the_matcher_refines_points_that_are_off(self):
        self.assertIn("matching moves", self.landmarks("add", self.b, self.a, *self.swapped(self.true_points(0.2))))
        self.landmarks("solve")
        self.assertLess(self.error_m(), 0.1)

    @staticmethod
    def swapped(options):
        return ["=".join(reversed(word.split("="))) if "=" in word else word for word in options]

    def test_what_is_refused_changes_nothing(self):
        before = (self.out / "journal").read_bytes()
        pair = (self.a, self.b)
        point = self.true_points()
        self.landmarks("add", *pair, *point[:2], status=2)
        self.landmarks("add", *pair, "--point", "1,2=3", "--point", "1,2=3,4", status=2)
        self.landmarks("add", self.a, 99, *point, status=2)
        self.landmarks("add", self.a, *point, status=2)
        self.assertIn("do not fit", self.landmarks("add", *pair, *point[:4], "--point", "9,9=0,0", status=1))
        # b and the one after it are tied well: that they are 30 m apart contradicts it.
        self.assertIn("refused", self.landmarks("add", self.b, self.b + 1, "--no-snap", "--frame", "submap",
                                                "--point", "30,0=0,0", "--point", "32,0=2,0", status=1))
        self.assertEqual((self.out / "journal").read_bytes(), before)
        self.landmarks("forbid", *pair)
        self.assertIn("forbidden", self.landmarks("add", *pair, *point, "--no-snap", status=1))
        self.landmarks("undo")
        self.landmarks("remove", *pair)
        self.assertIn("committed", self.landmarks("add", *pair, *point, "--no-snap"))

    def test_no_run_is_told(self):
        self.assertIn("no run", submapctl("landmarks", "list", self.folder, status=2))


if __name__ == "__main__":
    unittest.main()
