"""The real submapd in real time: emulated scanners on a cart that drives through an office, behind the real libusb."""
import os
import signal
import subprocess
import sys
import time

from daemon_folder import DaemonFolder

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
# Under the emulated bus, which outlives the daemon: a daemon at each word, what became of it, until it is over.
SUPERVISOR = """f=$1 && shift
while [ ! -e "$f/over" ]; do
  if [ -e "$f/go" ]; then
    rm "$f/go"; sh -c 'echo $$ >"$0/pid" && exec "$@"' "$f" "$@"; echo $? >"$f/left" && mv "$f/left" "$f/code"
  else sleep 0.02; fi
done"""


class LiveDaemon(DaemonFolder):
    """REQUIRES: a network of its own, and leave() at the end. `bus`: more words for hokuyo-sim. Its truth is in `truth`."""

    def __init__(self, submapctl, submapd, hokuyo_sim, folder, scanners=2, speed_m_s=1.2, bus=(), more=""):
        super().__init__(submapctl, submapd, folder, CONFIG.format(folder=folder) + more)
        self.truth = folder / "truth.jsonl"
        own, ordinary = ([], []) if subprocess.run(["chrt", "-f", "50", "true"], check=False).returncode else (
            ["chrt", "-f", "50"], ["chrt", "-o", "0"])
        with open(folder / "messages", "wb") as messages:
            self.process = subprocess.Popen(
                [*own, hokuyo_sim, "--scanners", str(scanners), "--speed", str(speed_m_s), "--stand", "5", "--boot", "0.5",
                 *bus, "--truth", self.truth, "--", *ordinary, "sh", "-c", SUPERVISOR, "sh", folder, submapd, "--foreground",
                 "--config", folder / "cart.toml"], stdout=messages, stderr=messages)

    def start(self):
        (self.folder / "pid").unlink(missing_ok=True)
        (self.folder / "go").touch()
        self.wait_for((self.folder / "pid").exists)

    def pid(self):
        return int((self.folder / "pid").read_text())

    def end(self, which):
        """What the daemon ended with; 128 and more for a signal's number."""
        os.kill(self.pid(), which)
        code = self.folder / "code"
        self.wait_for(code.exists, 60)
        ended = int(code.read_text())
        code.unlink()
        return ended

    def leave(self):
        """The bus and all that is on it, whatever state it is in."""
        (self.folder / "over").touch()
        if self.process.poll() is None and (self.folder / "pid").exists() and not (self.folder / "code").exists():
            try:
                os.kill(self.pid(), signal.SIGKILL)
            except ProcessLookupError:
                pass
        self.process.wait(timeout=60)

    def wait_for_scans(self, least, seconds=120):
        """Until so many are mapped, those included that are mapped again."""
        def mapped():
            time.sleep(0.1)  # each look is a process
            health = self.health()
            return health and health["mapper"]["scans"] >= least
        self.wait_for(mapped, seconds)

    def finish(self, trajectory_error, name="end"):
        """Saves the map, ends, verifies, and gives the trajectory's RMSE in cm."""
        saved = self.ctl("save-map", name, "--wait")
        assert saved.returncode == 0, saved.stderr
        code = self.end(signal.SIGTERM)
        assert code == 0, f"it ended with {code}:\n" + self.messages()
        verified = self.verify()
        assert verified.returncode == 0, verified.stdout + verified.stderr
        tum = self.folder / "truth.tum"
        truth = trajectory_error.with_name("live_truth.py")
        subprocess.run([sys.executable, truth, self.run() / "journal", self.truth, tum], check=True)
        return self.rmse_cm(trajectory_error, name, tum)[0]
