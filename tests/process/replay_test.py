#!/usr/bin/env python3
"""submapctl simulate and replay as others script against them. Usage: replay_test.py SUBMAPCTL"""
import json
import math
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tools"))
import trajectory_error  # noqa: E402

SUBMAPCTL = sys.argv.pop(1)

FILES = ["trajectory.tum", "trajectory_filter.tum", "map.pgm", "map.yaml", "map.png", "graph.g2o", "submaps",
         "metrics.json", "report.json", "journal", "poses"]
# Keys of metrics.json that design section 7 promises.
METRICS = {
    "scans": None, "scans_dropped": None, "log_s": None, "wall_s": None, "cpu_s": None, "realtime_factor": None,
    "scan_ms": ["mean", "p50", "p99", "p999", "max"], "scan_cpu_ms": ["mean", "p50", "p99", "p999", "max"],
    "peak_rss_mb": None, "particles": ["mean", "max", "share_above_1", "coalescences"], "submaps": None,
    "loops": ["candidates", "confirmed", "pending", "rejected"], "landmarks": None, "solver": ["calls", "ms_max"],
    "degenerate_s": None, "seed": None, "version": None,
}


def submapctl(*arguments):
    return subprocess.run([SUBMAPCTL, *map(str, arguments)], capture_output=True, text=True, check=False, timeout=300)


class ReplayTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.temporary.cleanup)
        cls.folder = pathlib.Path(cls.temporary.name)
        cls.simulate(cls.folder / "run")
        cls.log = cls.folder / "run.clf"

    @classmethod
    def simulate(cls, prefix, seed=3):
        result = submapctl("simulate", "office", "--out", prefix, "--minutes", "0.5", "--speed", "2", "--seed", seed)
        assert result.returncode == 0, result.stderr

    def replay(self, name, *options, log=None):
        out = self.folder / name
        result = submapctl("replay", log or self.log, "--out", out, *options)
        self.assertEqual(result.returncode, 0, result.stderr)
        return out

    def assert_same(self, a, b, names=("trajectory.tum", "trajectory_filter.tum", "graph.g2o", "map.pgm")):
        for name in names:
            self.assertEqual((a / name).read_bytes(), (b / name).read_bytes(), f"{name} of {a.name} and {b.name}")

    def test_same_bits_for_any_number_of_threads_and_every_file_is_there(self):
        one = self.replay("one", "--threads", "1")
        for name in FILES:
            self.assertTrue((one / name).exists(), name)
        self.assertTrue(list((one / "submaps").iterdir()))
        leftovers = {p.name for p in one.iterdir()} - set(FILES)
        self.assertFalse(leftovers, "files that nobody asked for")
        scans = len((self.folder / "run.truth.tum").read_text().splitlines())
        self.assertEqual(len((one / "trajectory.tum").read_text().splitlines()), scans)
        self.assertEqual(len((one / "trajectory_filter.tum").read_text().splitlines()), scans)
        graph = (one / "graph.g2o").read_text()
        for tag in ("VERTEX_SE2 ", "EDGE_SE2 ", "FIX "):
            self.assertIn(tag, graph)
        self.check_metrics(json.loads((one / "metrics.json").read_text()), scans)
        report = json.loads((one / "report.json").read_text())
        self.assertEqual(len(report["submaps"]), len(list((one / "submaps").iterdir())))
        self.assertEqual(len(report["matches"]), report["loops"]["confirmed"])
        self.assertEqual([link["b"] - link["a"] for link in report["links"]], [1] * (len(report["submaps"]) - 1))
        end = report["end"]
        poses = [[float(v) for v in line.split()] for line in (one / "trajectory.tum").read_text().splitlines()]
        there, = [pose for pose in poses if abs(pose[0] - end["stamp_us"] * 1e-6) < 1e-6]
        self.assertLess(math.dist(there[1:3], poses[-1][1:3]), 0.5, "no key-frame came after it")
        self.assertLess(math.dist(end["pose"][:2], there[1:3]), 0.01)
        self.assertGreater(end["covariance_bound"][0], 0.0)
        for threads in (2, 4):
            self.assert_same(one, self.replay(f"threads{threads}", "--threads", threads))

    def check_metrics(self, metrics, scans):
        for key, parts in METRICS.items():
            self.assertIn(key, metrics)
            for part in parts or []:
                self.assertIn(part, metrics[key], key)
        for name, use in metrics["bytes"].items():
            self.assertEqual(set(use), {"used", "peak", "limit"}, name)
            self.assertLessEqual(use["used"], use["limit"], name)
            self.assertLessEqual(use["peak"], use["limit"], name)
        self.assertEqual(metrics["scans"], scans)
        self.assertEqual(metrics["scans_dropped"], 0)
        self.assertEqual(metrics["seed"], 1)
        self.assertAlmostEqual(metrics["log_s"], 30.0, delta=1.0)
        self.assertGreater(metrics["submaps"], 0)

    def test_a_filter_of_particles_is_the_same_for_any_number_of_threads(self):
        one = self.replay("rbpf1", "--filter", "rbpf", "--particles", "5", "--threads", "1")
        two = self.replay("rbpf2", "--filter", "rbpf", "--particles", "5", "--threads", "2")
        self.assert_same(one, two)
        self.assertEqual(json.loads((one / "metrics.json").read_text())["particles"]["max"], 5)
        other = self.replay("rbpf3", "--filter", "rbpf", "--particles", "5", "--seed", "2")
        self.assertNotEqual((one / "trajectory.tum").read_bytes(), (other / "trajectory.tum").read_bytes())

    def test_chunks_of_a_log_are_joined_the_same_for_any_number_of_workers(self):
        prefix = self.folder / "long"
        result = submapctl("simulate", "office", "--out", prefix, "--minutes", "2.25", "--speed", "1", "--seed", "3")
        self.assertEqual(result.returncode, 0, result.stderr)
        log = self.folder / "half.clf"  # a chunk has two minutes; at 20 Hz they are mapped in a second
        lines = (self.folder / "long.clf").read_text().splitlines(True)
        scans = [line for line in lines if not line.startswith("#")]
        log.write_text("".join([line for line in lines if line.startswith("#")] + scans[::2]))
        one = self.replay("workers1", "--workers", "1", log=log)
        self.assertEqual({p.name for p in one.iterdir()}, set(FILES))
        truth = self.folder / "half.truth.tum"
        truth.write_text("".join((self.folder / "long.truth.tum").read_text().splitlines(True)[::2]))
        scans = len(scans[::2])
        for name in ("trajectory.tum", "trajectory_filter.tum"):
            self.assertEqual(len((one / name).read_text().splitlines()), scans)
        metrics = json.loads((one / "metrics.json").read_text())
        self.assertEqual((metrics["scans"], metrics["scans_dropped"], metrics["breaks"]), (scans, 0, 0))
        estimate, true = (trajectory_error.read_tum(path) for path in (one / "trajectory.tum", truth))
        pairs = [(e[1:], t[1:]) for e, t in zip(estimate, true, strict=True)]
        off = [math.hypot(e[0] - t[0], e[1] - t[1])
               for e, (_, t) in zip(trajectory_error.moved(pairs), pairs, strict=True)]
        self.assertLess(max(off), 0.10)
        for workers in (2, 4):
            self.assert_same(one, self.replay(f"workers{workers}", "--workers", workers, log=log))

    def test_workers_need_a_log_that_can_be_read_again(self):
        pipe = self.folder / "pipe"
        os.mkfifo(pipe)
        self.assert_usage_error([pipe, "--workers"], "replay", pipe, "--out", self.folder / "piped", "--workers", "2")

    def test_a_second_replay_into_the_same_folder_replaces_the_first(self):
        first = self.replay("again")
        before = {name: (first / name).read_bytes() for name in ("trajectory.tum", "graph.g2o", "map.pgm")}
        submaps = sorted(p.name for p in (first / "submaps").iterdir())
        self.replay("again")
        for name, content in before.items():
            self.assertEqual((first / name).read_bytes(), content, name)
        self.assertEqual(sorted(p.name for p in (first / "submaps").iterdir()), submaps)

    def test_a_run_as_one_map_says_what_was_full(self):
        config = self.folder / "one_map.toml"
        for keyframes, room in ((100, False), (600, True)):
            config.write_text(f"[experiment]\nsingle_map = true\n[submap]\nkeyframes = {keyframes}\n")
            out = self.folder / "one_map"
            result = submapctl("replay", self.log, "--out", out, "--config", config)
            self.assertEqual(result.returncode, 0, result.stderr)
            metrics = json.loads((out / "metrics.json").read_text())
            self.assertEqual(metrics["keyframes_refused"] == 0, room)
            self.assertEqual("warning: a sub-map was full" not in result.stdout, room, result.stdout)
            if room:
                self.assertEqual((metrics["submaps"], metrics["loops"]["candidates"]), (1, 0))

    def test_simulate_writes_the_same_bytes_for_the_same_seed(self):
        self.simulate(self.folder / "same")
        self.simulate(self.folder / "other", seed=4)
        for suffix in (".clf", ".truth.tum"):
            ours = (self.folder / ("run" + suffix)).read_bytes()
            self.assertEqual((self.folder / ("same" + suffix)).read_bytes(), ours)
            self.assertNotEqual((self.folder / ("other" + suffix)).read_bytes(), ours)

    def assert_usage_error(self, words, *arguments):
        result = submapctl(*arguments)
        self.assertEqual(result.returncode, 2, f"{arguments}: {result.stdout}{result.stderr}")
        for word in words:
            self.assertIn(str(word), result.stderr)

    def test_bad_usage_is_told(self):
        out = self.folder / "bad"
        missing = self.folder / "missing.clf"
        self.assert_usage_error([missing], "replay", missing, "--out", out)
        self.assert_usage_error([self.folder], "replay", self.folder, "--out", out)
        self.assert_usage_error(["--speeed"], "replay", self.log, "--out", out, "--speeed", "2")
        self.assert_usage_error(["--out"], "replay", self.log)
        self.assert_usage_error(["--filter"], "replay", self.log, "--out", out, "--filter", "kalman")
        self.assert_usage_error(["--particles"], "replay", self.log, "--out", out, "--particles", "0")
        self.assert_usage_error([], "replays", self.log)
        self.assert_usage_error([])
        world = self.folder / "world.pgm"
        self.assert_usage_error([world], "simulate", world, "--out", out)
        self.assertFalse(out.exists(), "a refused replay leaves nothing behind")

    def test_a_file_that_is_no_log_is_told(self):
        for name, content in (("noise.clf", os.urandom(5000)), ("empty.clf", b""), ("letter.log", b"Dear Sir,\n" * 50),
                              ("cut.clf.gz", b"\x1f\x8b\x08\x00"), ("noise.lcmlog", os.urandom(5000))):
            path = self.folder / name
            path.write_bytes(content)
            self.assert_usage_error([path], "replay", path, "--out", self.folder / ("out-" + name))

    def test_a_wrong_configuration_is_told_with_its_line(self):
        config = self.folder / "cart.toml"
        out = self.folder / "configured"
        config.write_text("[filter]\nmode = \"rbpf\"\npartikles = 3\n", encoding="utf-8")
        self.assert_usage_error([f"{config}:3: unknown key \"partikles\"", "particles"],
                                "replay", self.log, "--out", out, "--config", config)
        config.write_text("[filter]\nparticles = 0\n", encoding="utf-8")
        self.assert_usage_error([f"{config}:2: "], "replay", self.log, "--out", out, "--config", config)
        missing = self.folder / "missing.toml"
        self.assert_usage_error([missing], "replay", self.log, "--out", out, "--config", missing)
        self.assert_usage_error([self.folder], "replay", self.log, "--out", out, "--config", self.folder)
        self.assertFalse(out.exists())


if __name__ == "__main__":
    unittest.main()
