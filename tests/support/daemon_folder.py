"""The real submapd in a folder of its own, whatever feeds it: what it says, what it leaves on the disk."""
import json
import re
import subprocess
import sys
import time

MOST_UNRECORDED = 40  # scans: one second
EVENT_BYTES = 2366  # of a scan in the raw log


class DaemonFolder:
    """State, socket and messages of a submapd, and submapctl to ask it; who derives from it starts and ends one."""

    def __init__(self, submapctl, submapd, folder, config):
        self.submapctl = submapctl
        self.submapd = submapd
        self.folder = folder
        self.process = None
        folder.mkdir(exist_ok=True)
        (folder / "cart.toml").write_text(config)

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

    def rmse_cm(self, trajectory_error, map_name, truth):
        """Of a saved map's trajectory, and how many of its poses were compared."""
        told = subprocess.run([sys.executable, trajectory_error, self.run() / "maps" / map_name / "trajectory.tum", truth],
                              capture_output=True, text=True, check=True).stdout
        found = re.match(r"RMSE ([0-9.]+) cm.*\((\d+) of (\d+) poses\)", told)
        assert found, told
        return float(found[1]), int(found[2])
