#!/usr/bin/env python3
"""tools/trajectory_error.py on trajectories whose error is known. Usage: trajectory_error_test.py SCRIPT"""
import math
import pathlib
import subprocess
import sys
import tempfile
import unittest

SCRIPT = sys.argv.pop(1)


def tum(poses):
    return "".join(f"{t} {x} {y} 0 0 0 {math.sin(yaw / 2)} {math.cos(yaw / 2)}\n" for t, x, y, yaw in poses)


def moved(poses, x, y, turn):
    c, s = math.cos(turn), math.sin(turn)
    return [(t, x + c * px - s * py, y + s * px + c * py, yaw + turn) for t, px, py, yaw in poses]


class TrajectoryErrorTest(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        # A square of 10 m a side, heading along it and through the wrap at pi.
        self.truth = [(0.1 * i, *((i, 0), (10, i - 10), (30 - i, 10), (0, 40 - i))[min(i // 10, 3)], 0.16 * i)
                      for i in range(41)]

    def run_script(self, estimate, truth):
        paths = []
        for name, text in (("estimate", estimate), ("truth", truth)):
            path = pathlib.Path(self.folder.name, name)
            path.write_text(text, encoding="utf-8")
            paths.append(str(path))
        return subprocess.run([sys.executable, SCRIPT, *paths], capture_output=True, text=True, check=False)

    def test_rigid_motion_is_no_error(self):
        result = self.run_script(tum(moved(self.truth, 3.0, -7.0, 2.5)), tum(self.truth))
        self.assertEqual(result.stdout, "RMSE 0.00 cm, heading 0.000 deg (41 of 41 poses)\n")

    def test_known_errors_are_found(self):
        # Alternating by 5 cm in both axes, and 1 deg: the alignment cannot take it up.
        signs = [1 if i % 4 in (0, 3) else -1 for i in range(40)]
        estimate = [(t, x + 0.05 * s, y + 0.05 * s, yaw + math.radians(s))
                    for (t, x, y, yaw), s in zip(self.truth, signs)]
        result = self.run_script(tum(moved(estimate, 1.0, 1.0, 0.3)), tum(self.truth))
        position_cm, heading_deg = float(result.stdout.split()[1]), float(result.stdout.split()[4])
        self.assertAlmostEqual(position_cm, 100 * 0.05 * math.sqrt(2), delta=0.1)
        self.assertAlmostEqual(heading_deg, 1.0, delta=0.05)

    def test_truth_is_interpolated_and_gaps_are_not(self):
        between = [(t0 + 0.05, (x0 + x1) / 2, (y0 + y1) / 2, (a + b) / 2)
                   for (t0, x0, y0, a), (_, x1, y1, b) in zip(self.truth, self.truth[1:])]
        result = self.run_script(tum(between), tum(self.truth[:10] + self.truth[20:]))
        self.assertEqual(result.stdout, "RMSE 0.00 cm, heading 0.000 deg (29 of 40 poses)\n")

    def test_bad_input_is_refused(self):
        good = tum(self.truth)
        for estimate in ("", "# none\n", "1 2 3\n", "a b c d e f g h\n", tum([(1e6, 0, 0, 0), (1e6 + 1, 1, 0, 0)])):
            result = self.run_script(estimate, good)
            self.assertEqual(result.returncode, 1, estimate)
            self.assertNotIn("Traceback", result.stderr)


if __name__ == "__main__":
    unittest.main()
