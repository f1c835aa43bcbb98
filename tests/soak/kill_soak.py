#!/usr/bin/env python3
"""Kills submapd with SIGKILL at seeded instants of runs fed from a log in virtual time, restarts it, and looks at what is left.

Usage: kill_soak.py [--runs N] [--seed S] [--minutes M] [--path M] [--bus HOKUYO_SIM] SUBMAPCTL SUBMAPD TRAJECTORY_ERROR_PY
With --bus in real time, by an emulated scanner on a cart that stops at about the kill and stands until the daemon is back.
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
from daemon_folder import EVENT_BYTES, MOST_UNRECORDED
from fed_daemon import FedDaemon, simulate
from live_daemon import LiveDaemon

BUS_M_S = 0.5
FIRST_ON_THE_BUS = 240  # scans: the cart rolls
BUS_SCANS_AFTER = 720  # at least: the cart rolls again
BUS_STANDS_S = 10.0
BUS_ROLLS_AFTER_S = 3.5  # from the first scan to the first move, about


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


def on_the_bus(arguments, folder, bus=()):
    return LiveDaemon(arguments.submapctl, arguments.submapd, arguments.bus, folder, 1, BUS_M_S, bus,
                      f"[submap]\npath = {arguments.path}\n")


def undisturbed_on_the_bus(arguments, folder, scans):
    rig = on_the_bus(arguments, folder)
    try:
        rig.start()
        rig.wait_for(lambda: rig.raw_bytes() >= scans * EVENT_BYTES)
        return rig.finish(arguments.trajectory_error)
    finally:
        rig.leave()


def kill_on_the_bus(arguments, folder, scans):
    halt_s = max(0.0, scans / 40 - BUS_ROLLS_AFTER_S)
    rig = on_the_bus(arguments, folder, ["--halt", str(halt_s), "--halt-for", str(BUS_STANDS_S)])
    try:
        rig.start()
        rig.wait_for(lambda: rig.raw_bytes() >= scans * EVENT_BYTES)
        rig.end(signal.SIGKILL)
        recorded, mapped, before = rig.raw_scans(), rig.poses(), rig.submaps()
        assert recorded >= mapped - MOST_UNRECORDED, f"{mapped} scans were mapped, {recorded} are recorded"
        rig.start()
        rig.wait_for(lambda: rig.raw_bytes() >= (recorded + BUS_SCANS_AFTER) * EVENT_BYTES)
        rmse_cm = rig.finish(arguments.trajectory_error)
        after = rig.submaps()
        for name, content in before.items():
            assert after.get(name) == content, f"sub-map {name} is not what it was"
        return rmse_cm, len(before), recorded
    finally:
        rig.leave()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=0.5)
    parser.add_argument("--path", type=float, default=5.0, help="of a sub-map, m")
    parser.add_argument("--bus", help="hokuyo-sim")
    parser.add_argument("submapctl")
    parser.add_argument("submapd")
    parser.add_argument("trajectory_error", type=pathlib.Path)
    arguments = parser.parse_args()
    chance = random.Random(arguments.seed)
    with tempfile.TemporaryDirectory() as temporary:
        scratch = pathlib.Path(temporary)
        begun = time.monotonic()
        scans_of_run = int(arguments.minutes * 2400)
        if arguments.bus:
            first = FIRST_ON_THE_BUS
            limit_cm = 1.5 * undisturbed_on_the_bus(
                arguments, scratch / "undisturbed", scans_of_run + BUS_SCANS_AFTER)
        else:
            first = 0
            log = simulate(arguments.submapctl, scratch / "sim", arguments.minutes, arguments.seed)
            undisturbed = FedDaemon(arguments.submapctl, arguments.submapd, scratch / "undisturbed", log, arguments.path)
            undisturbed.start()
            undisturbed.wait_until_fed()
            limit_cm = 1.5 * undisturbed.finish(arguments.trajectory_error)
        print(f"undisturbed: RMSE at most {limit_cm:.2f} cm allowed", flush=True)
        worst_cm = 0.0
        failed = 0
        for i in range(arguments.runs):
            scans = chance.randrange(first, scans_of_run)
            try:
                folder = scratch / f"run{i}"
                rmse_cm, submaps, recorded = kill_on_the_bus(
                    arguments, folder, scans) if arguments.bus else kill_once(arguments, folder, log, scans, chance)
                assert rmse_cm <= limit_cm, f"RMSE {rmse_cm} cm"
                worst_cm = max(worst_cm, rmse_cm)
                print(f"run {i}: killed with {recorded} scans and {submaps} sub-maps, RMSE {rmse_cm} cm",
                      flush=True)
            except AssertionError as error:
                failed += 1
                print(f"run {i}: FAILED, killed at scan {scans}: {error}", flush=True)
            subprocess.run(["rm", "-rf", folder], check=True)
        print(f"{arguments.runs - failed} of {arguments.runs} runs lost nothing, worst RMSE {worst_cm:.2f} cm, "
              f"{time.monotonic() - begun:.0f} s")
        return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
