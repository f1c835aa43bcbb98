#!/usr/bin/env python3
"""The whole daemon in real time: two emulated scanners drive through an office, a map is saved each minute.

usage: live_soak.py [--seconds S] [--save-each S] [--limits] SUBMAPCTL SUBMAPD HOKUYO_SIM TOOLS_FOLDER

Fails if a scan is lost, dropped or not mapped, if a map is not saved or does not verify, or if the last one is bent. How
long a scan takes, the processor's share and the resident memory are printed, and judged with --limits only (a machine that
does nothing else). Run in a network of its own and, for real-time priorities, as root.
"""
import argparse
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time

CONFIG = """[scanner]
horizontal = "00900001"
vertical = "00900002"
vertical_z = 1.2
[daemon]
state = "{folder}/state"
control_socket = "{folder}/control"
[recorder]
disk_low = 0
disk_last = 0
"""
LATENCY_P99_MS, PROCESSOR_PERCENT, CODE_MB, GROWTH = 10.0, 15.0, 40.0, 1.02
RMSE_CM = 3.0
START_S = 30.0


class Daemon:
    def __init__(self, options, folder):
        self.options = options
        self.folder = folder
        self.truth = folder / "truth.jsonl"
        (folder / "cart.toml").write_text(CONFIG.format(folder=folder))
        own, ordinary = ([], []) if subprocess.run(["chrt", "-f", "50", "true"], check=False).returncode else (
            ["chrt", "-f", "50"], ["chrt", "-o", "0"])
        shell = f'echo $$ >{folder}/pid && exec "$@"'
        with open(folder / "messages", "wb") as messages:
            self.simulator = subprocess.Popen(
                [*own, options.hokuyo_sim, "--scanners", "2", "--speed", "1.2", "--stand", "5", "--boot", "0.5", "--truth",
                 self.truth, "--", *ordinary, "sh", "-c", shell, "sh", options.submapd, "--foreground", "--config",
                 folder / "cart.toml"], stdout=messages, stderr=messages)

    def ctl(self, *words):
        return subprocess.run([self.options.submapctl, *words, "--socket", str(self.folder / "control")],
                              capture_output=True, text=True, check=False, timeout=120)

    def health(self):
        result = self.ctl("health", "--json")
        return json.loads(result.stdout) if result.returncode == 0 else None

    def pid(self):
        return int((self.folder / "pid").read_text())

    def processor_s(self):
        fields = pathlib.Path(f"/proc/{self.pid()}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def end(self):
        if self.simulator.poll() is None:
            os.kill(self.pid(), signal.SIGTERM)
        return self.simulator.wait(timeout=60)


def drive(options, daemon):
    """Health each second, a map each minute. The figures, and what went wrong."""
    until = time.monotonic() + START_S
    while not (health := daemon.health()) or health["mapper"]["scans"] == 0:
        assert time.monotonic() < until and daemon.simulator.poll() is None, (daemon.folder / "messages").read_text()
        time.sleep(0.2)
    begun, processor_s = time.monotonic(), daemon.processor_s()
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
    processor = 100.0 * (daemon.processor_s() - processor_s) / (time.monotonic() - begun)
    return health, rss_mb, p99_ms, saves_s, processor, wrong


def rmse_cm(options, run, map_folder, daemon):
    tum = daemon.folder / "truth.tum"
    subprocess.run([sys.executable, options.tools / "live_truth.py", run / "journal", daemon.truth, tum], check=True)
    told = subprocess.run([sys.executable, options.tools / "trajectory_error.py", map_folder / "trajectory.tum", tum],
                          capture_output=True, text=True, check=True).stdout
    return float(re.match(r"RMSE ([0-9.]+) cm", told)[1]), told.strip()


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
        daemon = Daemon(options, pathlib.Path(temporary))
        try:
            health, rss_mb, p99_ms, saves_s, processor, wrong = drive(options, daemon)
            last = daemon.ctl("save-map", "last", "--wait")
        finally:
            code = daemon.end()
        messages = (daemon.folder / "messages").read_text()
        if code != 0 or last.returncode != 0:
            sys.exit(f"the daemon ended with {code}, save-map with {last.returncode} {last.stderr}\n{messages}")
        run, = (daemon.folder / "state/runs").iterdir()
        verified = subprocess.run([options.submapctl, "verify", str(run)], capture_output=True, text=True, check=False,
                                  timeout=120)
        if verified.returncode != 0:
            wrong.append(verified.stdout + verified.stderr)
        error_cm, told = rmse_cm(options, run, run / "maps/last", daemon)

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
    print(f"{len(saves_s)} maps saved, {max(saves_s, default=0.0):.1f} s at most; {told}")
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
