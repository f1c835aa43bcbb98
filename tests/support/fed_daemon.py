"""The real submapd, fed with a simulated log in virtual time: for tests that end it, kill it, or take its disk away."""
import json
import os
import re
import signal
import subprocess
import sys
import time

CONFIG = """[scanner]
horizontal = "1"
[daemon]
state = "{folder}/state"
control_socket = "{folder}/control"
[submap]
path = {path}
[recorder]
disk_low = 0
disk_last = 0
"""
MOST_UNRECORDED = 40  # scans: one second
EVENT_BYTES = 2366  # of a scan in the raw log


class FedDaemon:
    """submapd and submapctl in a folder of their own; `log` is a simulated one with its truth beside it."""

    def __init__(self, submapctl, submapd, folder, log, path_m=5.0, more=""):
        self.submapctl = submapctl
        self.submapd = submapd
        self.folder = folder
        self.log = log
        self.process = None
        folder.mkdir()
        (folder / "cart.toml").write_text(CONFIG.format(folder=folder, path=path_m) + more)

    def start(self, source=None, before=(), environment=None):
        """`before`: words before the program's own."""
        with open(self.folder / "messages", "ab") as messages:
            self.process = subprocess.Popen([*before, self.submapd, "--foreground", "--config", self.folder / "cart.toml",
                                             "--input", source or self.log], stdout=messages, stderr=messages,
                                            env={**os.environ, **(environment or {})})

    def end(self, which):
        self.process.send_signal(which)
        return self.process.wait(timeout=60)

    def ctl(self, *words, timeout=120):
        return subprocess.run([self.submapctl, *words, "--socket", str(self.folder / "control")],
                              capture_output=True, text=True, check=False, timeout=timeout)

    def health(self):
        result = self.ctl("health", "--json")
        try:
            return json.loads(result.stdout)
        except json.JSONDecodeError:
            return None

    def wait_for(self, condition, seconds=120):
        until = time.monotonic() + seconds
        while not (value := condition()):
            assert self.process.poll() is None, "the daemon has ended:\n" + self.messages()
            assert time.monotonic() < until, "waited in vain; the daemon said:\n" + self.messages()
            time.sleep(0.01)
        return value

    def wait_until_fed(self):
        def fed():
            health = self.health()
            return health and health["input_ended"] and health["optimizer"]["submaps"] > health["recorder"]["last_submap"]
        self.wait_for(fed)

    def run(self):
        runs = list((self.folder / "state" / "runs").iterdir()) if (self.folder / "state" / "runs").exists() else []
        assert len(runs) <= 1, f"another run was begun: {runs}"
        return runs[0] if runs else None

    def submaps(self):
        run = self.run()
        if run is None or not (run / "submaps").is_dir():
            return {}
        return {p.name: p.read_bytes() for p in (run / "submaps").iterdir() if not p.name.startswith(".")}

    def raw_scans(self):
        run = self.run()
        files = sorted(run.glob("raw-*.lcmlog")) if run else []
        return sum(p.read_bytes().count(b"CART_SCAN_H") for p in files)

    def raw_bytes(self):
        run = self.run()
        return sum(p.stat().st_size for p in run.glob("raw-*.lcmlog")) if run else 0

    def poses(self):
        """Scans that were mapped, as the disk has it."""
        run = self.run()
        return max((run / "poses").stat().st_size - 16, 0) // 72 if run and (run / "poses").exists() else 0

    def messages(self):
        return (self.folder / "messages").read_text()

    def verify(self, path=None):
        return subprocess.run([self.submapctl, "verify", str(path or self.run())], capture_output=True, text=True,
                              check=False, timeout=60)

    def finish(self, trajectory_error):
        """Saves the map, ends, verifies, and gives the trajectory's RMSE in cm."""
        self.wait_until_fed()
        saved = self.ctl("save-map", "end", "--wait")
        assert saved.returncode == 0, saved.stderr
        assert self.end(signal.SIGTERM) == 0
        verified = self.verify()
        assert verified.returncode == 0, verified.stdout + verified.stderr
        told = subprocess.run([sys.executable, trajectory_error, self.run() / "maps/end/trajectory.tum",
                               self.log.with_name("sim.truth.tum")], capture_output=True, text=True, check=True).stdout
        found = re.match(r"RMSE ([0-9.]+) cm.*\((\d+) of (\d+) poses\)", told)
        assert found, told
        assert int(found[2]) >= self.scans_of_log() - MOST_UNRECORDED, told
        return float(found[1])

    def scans_of_log(self):
        return len(self.log.with_name("sim.truth.tum").read_text().splitlines())


def simulate(submapctl, prefix, minutes, seed=1):
    """PREFIX.lcmlog and PREFIX.truth.tum; give a prefix that ends in `sim`."""
    subprocess.run([submapctl, "simulate", "office", "--out", prefix, "--minutes", str(minutes), "--speed", "1.5", "--seed",
                    str(seed), "--format", "lcmlog"], check=True, stdout=subprocess.DEVNULL)
    return prefix.with_name(prefix.name + ".lcmlog")
