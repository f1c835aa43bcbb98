#!/usr/bin/env python3
"""The whole daemon in real time: two emulated scanners drive through an office, a map is saved each minute.

usage: live_soak.py [--seconds S] [--save-each S] [--limits] SUBMAPCTL SUBMAPD HOKUYO_SIM TOOLS_FOLDER

Fails if a scan is lost, dropped or not mapped, if a map is not saved or does not verify, or if the last one is bent. How
long a scan takes, the processor's share and the resident memory are printed, and judged with --limits only (a machine that
does nothing else). Run in a network of its own and, for real-time priorities, as root.
"""
import argparse
import os
import pathlib
import shutil
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "support"))
from live_daemon import LiveDaemon

LATENCY_P99_MS, PROCESSOR_PERCENT, CODE_MB, GROWTH = 10.0, 15.0, 40.0, 1.02
RMSE_CM = 3.0
START_S = 30.0


def processor_s(pid):
    fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def drive(options, daemon):
    """Health each second, a map each minute. The figures, and what went wrong."""
    daemon.start()
    daemon.wait_for_scans(1, START_S)
    begun, before_s = time.monotonic(), processor_s(daemon.pid())
    rss_mb, p99_ms, saves_s, wrong = [], [], [], []
    next_save = options.save_each
    while (at := time.monotonic() - begun) < options.seconds:
        if at >= next_save:
            start = time.monotonic()
            saved = daemon.ctl("save-map", f"at-{next_save:.0f}", "--wait")
            saves_s.append(time.monotonic() - start)
            if saved.returncode != 0:
                wrong.append(f"save-map: {saved.stderr}")
            next_save += options.save_each
        health = daemon.health()
        rss_mb.append((at, health["memory"]["rss_bytes"] / 1e6))
        p99_ms.append(health["publisher"]["scan_ms_p99"])
        time.sleep(1.0)
    processor = 100.0 * (processor_s(daemon.pid()) - before_s) / (time.monotonic() - begun)
    return health, rss_mb, p99_ms, saves_s, processor, wrong


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--save-each", type=float, default=60.0)
    parser.add_argument("--limits", action="store_true")
    for name in ("submapctl", "submapd", "hokuyo_sim", "tools"):
        parser.add_argument(name, type=pathlib.Path)
    options = parser.parse_args()
    if not shutil.which("umockdev-wrapper"):
        print("SKIPPED: live_soak: there is no umockdev-wrapper here (tools/setup installs it)", file=sys.stderr)
        return 77
    with tempfile.TemporaryDirectory() as temporary:
        daemon = LiveDaemon(options.submapctl, options.submapd, options.hokuyo_sim, pathlib.Path(temporary))
        try:
            health, rss_mb, p99_ms, saves_s, processor, wrong = drive(options, daemon)
            error_cm = daemon.finish(options.tools / "trajectory_error.py", "last")
        finally:
            daemon.leave()

    mapper, recorder = health["mapper"], health["recorder"]
    lost = {"mapper lost": mapper["lost"], "mapper missing": mapper["missing"], "mapper skipped": mapper["skipped"],
            "recorder lost": recorder["raw_lost"]}
    for scanner in health["scanners"]:
        lost[f"{scanner} dropped"] = health["scanners"][scanner]["dropped"]
    limit_mb = health["memory"]["budget_bytes"] / 1e6 + CODE_MB
    settled_mb = max([mb for at, mb in rss_mb if at <= 60.0])
    last_mb = rss_mb[-1][1]
    print(f"{mapper['scans']} scans mapped, {recorder['raw_scans']} recorded; " +
          ", ".join(f"{what} {count}" for what, count in lost.items()))
    print(f"scan in ring to pose published: p99 {p99_ms[-1]:.1f} ms (worst read {max(p99_ms):.1f}); {processor:.1f} % of a core; "
          f"{health['optimizer']['submaps']} sub-maps, {health['optimizer']['loops_confirmed']} loops")
    print(f"memory: {settled_mb:.1f} MB in the first minute, {last_mb:.1f} at the end, {max(mb for _, mb in rss_mb):.1f} at most, "
          f"limit {limit_mb:.0f}")
    print(f"{len(saves_s)} maps saved, {max(saves_s, default=0.0):.1f} s at most; RMSE {error_cm:.2f} cm")
    wrong += [f"{what}: {count}" for what, count in lost.items() if count]
    if error_cm > RMSE_CM:
        wrong.append(f"the last map is {error_cm} cm from the truth")
    if len(saves_s) < int(options.seconds / options.save_each) - 1:
        wrong.append("not every map was asked for")
    if options.limits:
        if p99_ms[-1] > LATENCY_P99_MS:
            wrong.append(f"p99 above {LATENCY_P99_MS} ms")
        if processor > PROCESSOR_PERCENT:
            wrong.append(f"more than {PROCESSOR_PERCENT} % of a core")
        if last_mb > GROWTH * settled_mb or max(mb for _, mb in rss_mb) > limit_mb:
            wrong.append("memory grew")
    for what in wrong:
        print(f"WRONG: {what}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
