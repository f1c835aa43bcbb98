#!/usr/bin/env python3
"""submapd fed with a log in virtual time: what it leaves, what verify says of it, and what a full disk does.

Usage: fed_daemon_test.py SUBMAPCTL SUBMAPD DISK_FULL_SO CLOCK_STEP_SO TRAJECTORY_ERROR_PY
"""
import pathlib
import random
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "support"))
from fed_daemon import FedDaemon, simulate

TRAJECTORY_ERROR = sys.argv.pop()
CLOCK_STEP = sys.argv.pop()
DISK_FULL = sys.argv.pop()
SUBMAPD = sys.argv.pop()
SUBMAPCTL = sys.argv.pop()
SCANS = 480


class FedDaemonTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.temporary.cleanup)
        cls.folder = pathlib.Path(cls.temporary.name)
        cls.log = simulate(SUBMAPCTL, cls.folder / "sim", SCANS / 2400)

    def rig(self, name, more=""):
        rig = FedDaemon(SUBMAPCTL, SUBMAPD, self.folder / name, self.log, 3.0, more)
        self.addCleanup(lambda: rig.process and rig.process.poll() is None and rig.end(signal.SIGKILL))
        return rig

    def assert_whole(self, rig):
        verified = rig.verify()
        self.assertEqual(verified.returncode, 0, verified.stdout + verified.stderr)

    def assert_damaged(self, path, word):
        result = subprocess.run([SUBMAPCTL, "verify", path], capture_output=True, text=True, check=False, timeout=60)
        self.assertEqual(result.returncode, 1, f"{word}: {result.stdout}{result.stderr}")
        self.assertIn(word, result.stderr)

    def test_what_is_fed_is_what_replay_maps_and_verify_finds_every_damage(self):
        rig = self.rig("whole", "raw_file = 262144\n")
        rig.start()
        rig.finish(TRAJECTORY_ERROR)
        run = rig.run()
        self.assertGreater(len(list(run.glob("raw-*.lcmlog"))), 3)
        replayed = subprocess.run([SUBMAPCTL, "replay", run, "--out", self.folder / "again", "--config",
                                   rig.folder / "cart.toml"], capture_output=True, text=True, check=False, timeout=120)
        self.assertEqual(replayed.returncode, 0, replayed.stderr)
        again = {p.name: p.read_bytes() for p in (self.folder / "again" / "submaps").iterdir()}
        self.assertGreater(len(again), 2)
        self.assertEqual(rig.submaps(), again, "a folder's raw files give the same sub-maps, bit for bit")

        self.assert_whole(rig)
        for path in (run / "journal", run / "poses", run / "raw-0001.lcmlog", run / "submaps" / "000001.submap",
                     run / "maps" / "end"):
            self.assertEqual(rig.verify(path).returncode, 0, path)
        self.assertEqual(rig.verify(self.folder / "nothing").returncode, 2)
        self.assertEqual(rig.verify(self.folder).returncode, 2)

        chance = random.Random(1)
        for path in (p for p in sorted(run.rglob("*")) if p.is_file()):
            whole = path.read_bytes()
            at = chance.randrange(len(whole) // 4, len(whole) // 2)
            if path.suffix == ".lcmlog":
                at = whole.index(b"\xed\xa1\xda\x01", at)  # a scan's ranges have no checksum
            path.write_bytes(whole[:at] + bytes([whole[at] ^ 0x55]) + whole[at + 1:])
            self.assert_damaged(run, "MANIFEST" if path.name == "MANIFEST" else path.name)
            if path.suffix == ".submap" or path.parent.name == "end":
                path.unlink()
                self.assert_damaged(run, path.name)
            path.write_bytes(whole)
        (run / "submaps" / "000099.submap").write_bytes(b"SUBMAPD\n")
        self.assert_damaged(run, "000099.submap")
        (run / "submaps" / "000099.submap").unlink()
        (run / "maps" / "end" / "more").write_bytes(b"")
        self.assert_damaged(run, "more")
        (run / "maps" / "end" / "more").unlink()
        self.assert_whole(rig)

    def kill_in_the_middle(self, rig, submaps=3):
        rig.start()
        rig.wait_for(lambda: len(rig.submaps()) >= submaps)
        rig.end(signal.SIGKILL)

    def test_torn_tails_after_a_power_cut_are_no_loss(self):
        rig = self.rig("torn")
        self.kill_in_the_middle(rig)
        run = rig.run()
        before = rig.submaps()
        raw = run / "raw-0000.lcmlog"
        raw.write_bytes(raw.read_bytes()[:-1000])  # within an event
        with open(run / "poses", "ab") as poses:
            poses.write(bytes(300))
        with open(run / "journal", "ab") as journal:
            journal.write(b"\x20\x00\x00\x00\x02torn")
        (run / "submaps" / ".000009.submap.1.0.tmp").write_bytes(b"half")
        (run / "maps" / ".hall.abcdef").mkdir()
        self.assert_whole(rig)
        rig.start()
        rig.finish(TRAJECTORY_ERROR)
        after = rig.submaps()
        for name, content in before.items():
            self.assertEqual(after[name], content, name)
        self.assertTrue((run / "raw-0001.lcmlog").exists())
        self.assertEqual([p.name for p in (run / "maps").iterdir()], ["end"], "what was half written is gone")
        rig.start()  # ended by SIGTERM: another run begins
        rig.wait_for(lambda: len(list((rig.folder / "state" / "runs").iterdir())) == 2)

    def test_a_damaged_run_stays_as_it_is_and_another_begins(self):
        rig = self.rig("damaged")
        self.kill_in_the_middle(rig)
        run = rig.run()
        newest = sorted((run / "submaps").glob("0*.submap"))[-1]
        journal = (run / "journal").read_bytes()
        newest.write_bytes(b"SUBMAPD\n" + bytes(100))
        (run / "journal").write_bytes(journal)
        for path in sorted((run / "submaps").glob("0*.submap"))[:-1]:
            path.write_bytes(path.read_bytes()[:-1] + b"?")
        rig.start()
        rig.wait_for(lambda: len(list((rig.folder / "state" / "runs").iterdir())) == 2)
        rig.wait_for(rig.health)
        self.assertIn("a new run begins", rig.messages())
        self.assertEqual((run / "journal").read_bytes(), journal)

    def test_a_disk_that_is_full_for_a_while_at_any_write_loses_no_submap(self):
        chance = random.Random(2)
        for i in range(6):
            rig = self.rig(f"full{i}")
            first = chance.randrange(30, 1200)
            rig.start(environment={"LD_PRELOAD": DISK_FULL, "DISK_FULL_FOLDER": str(rig.folder / "state" / "runs"),
                                   "DISK_FULL_FROM": str(first), "DISK_FULL_FOR": "25"})
            rig.wait_until_fed()
            rig.wait_for(lambda rig=rig: rig.health()["mapper"]["scans"] == SCANS)
            health = rig.health()
            self.assertEqual(health["mapper"]["skipped"], 0)
            self.assertLessEqual(health["recorder"]["raw_lost"], 25)
            self.assertEqual(rig.end(signal.SIGTERM), 0)
            self.assertIn("No space left on device", rig.messages())
            self.assert_whole(rig)
            self.assertGreater(len(rig.submaps()), 2)
            shutil.rmtree(rig.folder)

    def test_submaps_that_a_full_disk_refuses_to_the_end_come_at_the_next_start(self):
        rig = self.rig("refused")
        rig.start(environment={"LD_PRELOAD": DISK_FULL, "DISK_FULL_FOLDER": str(rig.folder / "state" / "runs"),
                               "DISK_FULL_FROM": "700", "DISK_FULL_FOR": "1000000"})
        rig.wait_for(lambda: "No space left" in rig.messages())
        begun = time.monotonic()
        self.assertEqual(rig.end(signal.SIGTERM), 0)
        self.assertLess(time.monotonic() - begun, 10.0)
        before = rig.submaps()
        rig.start()
        self.assertGreater(rig.finish(TRAJECTORY_ERROR), 0.0)
        self.assertGreater(len(rig.submaps()), len(before))

    def test_a_clock_that_is_set_is_noted_and_bends_nothing(self):
        rig = self.rig("clock")
        steps = rig.folder / "steps"
        steps.write_text(str(-int(time.time())))  # no battery: it is 1970
        rig.start(environment={"LD_PRELOAD": CLOCK_STEP, "CLOCK_STEP_FILE": str(steps)})
        rig.wait_for(rig.health)
        for seconds in ("0", "3600", "0"):
            told = rig.messages().count("clock was set")
            (rig.folder / "new").write_text(seconds)
            (rig.folder / "new").rename(steps)
            rig.wait_for(lambda told=told: rig.messages().count("clock was set") > told)
        self.assertIn("clock was set +3600.0 s", rig.messages())
        self.assertIn("clock was set -3600.0 s", rig.messages())
        rig.finish(TRAJECTORY_ERROR)
        journal = (rig.run() / "journal").read_bytes()
        record = struct.pack("<IB", 17, 10)  # length and type of a step
        self.assertEqual(journal.count(record), 3)

    def test_where_nothing_can_be_written_it_says_so(self):
        rig = self.rig("readonly")
        (rig.folder / "state").mkdir()
        made = subprocess.run(["unshare", "-m", "true"], check=False, capture_output=True)
        if made.returncode != 0:
            self.skipTest("this machine does not let us mount (unshare -m)")
        rig.start(before=["unshare", "-m", "sh", "-c", 'mount -t tmpfs -o ro none "$0" && exec "$@"',
                          str(rig.folder / "state")])
        self.assertEqual(rig.process.wait(timeout=20), 1)
        self.assertIn("Read-only file system", rig.messages())
        self.assertIn("[daemon] state", rig.messages())

    def test_a_slow_mapper_sheds_scans_and_the_raw_log_has_all(self):
        # Over LCM, where nobody waits: five times slower than the scans come.
        if shutil.which("lcm-logplayer") is None:
            self.skipTest("no lcm-logplayer")
        rig = self.rig("slow", '[experiment]\nslow_mapper = 125\n')
        rig.start(source="lcm")
        rig.wait_for(lambda: (health := rig.health()) and not health["message"])
        subprocess.run(["lcm-logplayer", self.log], check=True, stdout=subprocess.DEVNULL, timeout=60)
        rig.wait_for(lambda: rig.health()["recorder"]["raw_scans"] >= SCANS)
        health = rig.health()
        self.assertGreater(health["mapper"]["skipped"], SCANS // 4)
        self.assertEqual(health["recorder"]["raw_lost"], 0)
        self.assertEqual(rig.end(signal.SIGTERM), 0)
        self.assertEqual(rig.raw_scans(), SCANS)
        self.assert_whole(rig)


if __name__ == "__main__":
    unittest.main()
