"""The real submapd, fed with a simulated log in virtual time: for tests that end it, kill it, or take its disk away."""
import os
import signal
import subprocess

from daemon_folder import MOST_UNRECORDED, DaemonFolder

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


class FedDaemon(DaemonFolder):
    """`log` is a simulated one with its truth beside it."""

    def __init__(self, submapctl, submapd, folder, log, path_m=5.0, more=""):
        super().__init__(submapctl, submapd, folder, CONFIG.format(folder=folder, path=path_m) + more)
        self.log = log

    def start(self, source=None, before=(), environment=None):
        """`before`: words before the program's own."""
        with open(self.folder / "messages", "ab") as messages:
            self.process = subprocess.Popen([*before, self.submapd, "--foreground", "--config", self.folder / "cart.toml",
                                             "--input", source or self.log], stdout=messages, stderr=messages,
                                            env={**os.environ, **(environment or {})})

    def end(self, which):
        self.process.send_signal(which)
        return self.process.wait(timeout=60)

    def wait_until_fed(self):
        def fed():
            health = self.health()
            return health and health["input_ended"] and health["optimizer"]["submaps"] > health["recorder"]["last_submap"]
        self.wait_for(fed)

    def finish(self, trajectory_error):
        """Saves the map, ends, verifies, and gives the trajectory's RMSE in cm."""
        self.wait_until_fed()
        saved = self.ctl("save-map", "end", "--wait")
        assert saved.returncode == 0, saved.stderr
        assert self.end(signal.SIGTERM) == 0
        verified = self.verify()
        assert verified.returncode == 0, verified.stdout + verified.stderr
        rmse_cm, poses = self.rmse_cm(trajectory_error, "end", self.log.with_name("sim.truth.tum"))
        assert poses >= self.scans_of_log() - MOST_UNRECORDED, f"{poses} poses"
        return rmse_cm

    def scans_of_log(self):
        return len(self.log.with_name("sim.truth.tum").read_text().splitlines())


def simulate(submapctl, prefix, minutes, seed=1):
    """PREFIX.lcmlog and PREFIX.truth.tum; give a prefix that ends in `sim`."""
    subprocess.run([submapctl, "simulate", "office", "--out", prefix, "--minutes", str(minutes), "--speed", "1.5", "--seed",
                    str(seed), "--format", "lcmlog"], check=True, stdout=subprocess.DEVNULL)
    return prefix.with_name(prefix.name + ".lcmlog")
