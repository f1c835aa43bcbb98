#!/usr/bin/env python3
"""A short run of submapd, once for each call that writes a file, gives it its name, or syncs it: that call finds the disk full.

Usage: disk_full_soak.py [--start CALLS] [--step N] [--seconds S] [--failing N] SUBMAPCTL SUBMAPD DISK_FULL_SO
Each run is fed in virtual time, saves its map, and ends by SIGTERM. The disk refuses call number 0, then (in another run)
the next until START of them, and from there each N-th until a run ends before the call comes. Either the daemon says at its start what is wrong, and the
next start goes well; or it maps all scans, loses no sub-map, says that the disk is full, saves the map (a save that was
refused says so, and the next one succeeds), and what it leaves verifies. Run in a network of its own.
"""
import argparse
import pathlib
import shutil
import signal
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "support"))
from fed_daemon import FedDaemon, simulate

FULL = "No space left on device"


def save(rig):
    """How many tries it took."""
    tries = 0
    while tries < 2:
        tries += 1
        saved = rig.ctl("save-map", "end", "--wait")
        if saved.returncode == 0:
            return tries
        assert FULL in saved.stderr + saved.stdout, f"a save was refused: {saved.stderr}"
    raise AssertionError("no map could be saved although there was room again: " + saved.stderr)


def run_once(arguments, folder, log, call, submaps):
    """What became of the run, which has so many sub-maps; nothing if it ended before that call."""
    rig = FedDaemon(arguments.submapctl, arguments.submapd, folder, log, 2.0)
    try:
        rig.start(environment={"LD_PRELOAD": arguments.disk_full, "DISK_FULL_FOLDER": str(folder / "state"),
                               "DISK_FULL_FROM": str(call), "DISK_FULL_FOR": str(arguments.failing)})
        while rig.process.poll() is None and not rig.health():
            time.sleep(0.01)
        what = "went on"
        if rig.process.poll() is not None:
            assert rig.process.returncode == 1 and FULL in rig.messages(), rig.messages()
            what = "did not start, and then did"
            rig.start()
        rig.wait_until_fed()
        rig.wait_for(lambda: rig.health()["mapper"]["scans"] == rig.scans_of_log())
        health = rig.health()
        assert health["mapper"]["skipped"] == 0
        assert health["recorder"]["raw_lost"] <= arguments.failing
        if save(rig) > 1:
            what = "saved the map at the second try"
        assert rig.end(signal.SIGTERM) == 0, rig.messages()
        if len(rig.submaps()) < submaps:  # the last one was refused: the run goes on
            what = "gave its last sub-map at the next start"
            rig.start()
            rig.wait_until_fed()
            assert rig.end(signal.SIGTERM) == 0, rig.messages()
        verified = rig.verify()
        assert verified.returncode == 0, verified.stdout + verified.stderr
        assert len(rig.submaps()) == submaps, f"{len(rig.submaps())} sub-maps are left of {submaps}"
        return what if FULL in rig.messages() or what.startswith("saved") else None
    finally:
        if rig.process.poll() is None:
            rig.end(signal.SIGKILL)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--start", type=int, default=0, help="calls that are refused one by one, whatever the step")
    parser.add_argument("--step", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--failing", type=int, default=1, help="calls that fail in a row")
    parser.add_argument("submapctl")
    parser.add_argument("submapd")
    parser.add_argument("disk_full")
    arguments = parser.parse_args()
    failed = 0
    outcomes = {}
    begun = time.monotonic()
    with tempfile.TemporaryDirectory() as temporary:
        scratch = pathlib.Path(temporary)
        log = simulate(arguments.submapctl, scratch / "sim", arguments.seconds / 60.0)
        undisturbed = FedDaemon(arguments.submapctl, arguments.submapd, scratch / "undisturbed", log, 2.0)
        undisturbed.start()
        undisturbed.wait_until_fed()
        assert undisturbed.end(signal.SIGTERM) == 0, undisturbed.messages()
        submaps = len(undisturbed.submaps())
        call = runs = 0
        while True:
            try:
                what = run_once(arguments, scratch / "run", log, call, submaps)
                if what is None:
                    break
                outcomes[what] = outcomes.get(what, 0) + 1
            except AssertionError as error:
                failed += 1
                print(f"call {call}: FAILED: {error}", flush=True)
            shutil.rmtree(scratch / "run")
            runs += 1
            call += 1 if call < arguments.start else arguments.step
    print(f"{runs} of calls 0 to {call}: {outcomes}, {failed} failed, "
          f"{time.monotonic() - begun:.0f} s")
    return 1 if failed or not outcomes else 0


if __name__ == "__main__":
    sys.exit(main())
