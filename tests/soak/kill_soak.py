#!/usr/bin/env python3
"""Kills submapd with SIGKILL at seeded instants of runs fed from a log in virtual time, restarts it, and looks at what is left.

Usage: kill_soak.py [--runs N] [--seed S] [--minutes M] [--keep] SUBMAPCTL SUBMAPD TRAJECTORY_ERROR_PY
Each run must keep every finished sub-map and at least all raw scans but the last second's, its maps must verify, and the
trajectory's RMSE must be at most 1.5 times the undisturbed run's. Run in a network of its own (in_own_network.sh).
"""
import argparse
import pathlib
import random
import signal
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "support"))
from fed_daemon import EVENT_BYTES, MOST_UNRECORDED, FedDaemon, simulate


def kill_at(rig, scans):
    """Kills the daemon as soon as so many scans are recorded."""
    rig.start()
    while rig.raw_bytes() < scans * EVENT_BYTES and rig.process.poll() is None:
        time.sleep(0.001)
    rig.end(signal.SIGKILL)


def kill_once(arguments, folder, log, scans, chance):
    rig = FedDaemon(arguments.submapctl, arguments.submapd, folder, log, arguments.path)
    if chance.random() < 0.2:  # while a map is being written
        rig.start()
        rig.wait_for(rig.health)
        rig.ctl("save-map", "early")
        time.sleep(chance.uniform(0.0, 1.0))
        rig.end(signal.SIGKILL)
    else:
        kill_at(rig, scans)
    if chance.random() < 0.2:  # and again while it goes on
        rig.start()
        time.sleep(chance.uniform(0.0, 0.5))
        rig.end(signal.SIGKILL)
    recorded = rig.raw_scans()
    mapped = rig.poses()
    assert recorded >= mapped - MOST_UNRECORDED, f"{mapped} scans were mapped, {recorded} are recorded"
    before = rig.submaps()
    rig.start()
    rmse_cm = rig.finish(arguments.trajectory_error)
    after = rig.submaps()
    for name, content in before.items():
        assert after.get(name) == content, f"sub-map {name} is not what it was"
    return rmse_cm, len(before), recorded


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=0.5)
    parser.add_argument("--path", type=float, default=5.0, help="of a sub-map, m")
    parser.add_argument("submapctl")
    parser.add_argument("submapd")
    parser.add_argument("trajectory_error")
    arguments = parser.parse_args()
    chance = random.Random(arguments.seed)
    with tempfile.TemporaryDirectory() as temporary:
        scratch = pathlib.Path(temporary)
        log = simulate(arguments.submapctl, scratch / "sim", arguments.minutes, arguments.seed)
        undisturbed = FedDaemon(arguments.submapctl, arguments.submapd, scratch / "undisturbed", log, arguments.path)
        begun = time.monotonic()
        undisturbed.start()
        undisturbed.wait_until_fed()
        limit_cm = 1.5 * undisturbed.finish(arguments.trajectory_error)
        print(f"undisturbed: RMSE at most {limit_cm:.2f} cm allowed", flush=True)
        worst_cm = 0.0
        failed = 0
        for i in range(arguments.runs):
            scans = chance.randrange(undisturbed.scans_of_log())
            try:
                rmse_cm, submaps, recorded = kill_once(arguments, scratch / f"run{i}", log, scans, chance)
                assert rmse_cm <= limit_cm, f"RMSE {rmse_cm} cm"
                worst_cm = max(worst_cm, rmse_cm)
                print(f"run {i}: killed with {recorded} scans and {submaps} sub-maps, RMSE {rmse_cm} cm",
                      flush=True)
            except AssertionError as error:
                failed += 1
                print(f"run {i}: FAILED, killed at scan {scans}: {error}", flush=True)
            subprocess.run(["rm", "-rf", scratch / f"run{i}"], check=True)
        print(f"{arguments.runs - failed} of {arguments.runs} runs lost nothing, worst RMSE {worst_cm:.2f} cm, "
              f"{time.monotonic() - begun:.0f} s")
        return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
