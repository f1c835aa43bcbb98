"""The packages on a real Debian machine: QEMU, Debian's kernel, udev, two scanners plugged in over USB/IP, a power cut.

usage: vm_test.py PACKAGES_FOLDER HOKUYO_SIM CACHE_FOLDER; exit code 77: not possible here.

The scanners are emulated on the host (hokuyo-sim --front usbip), the guest's vhci-hcd plugs them in. The power cut is a
SIGKILL to QEMU; the disk, ext4 with its journal, is kept and booted again. QEMU emulates the processor (TCG), so nothing
here measures time. What happens inside is in guest.sh.

By hand until it has run to its end: so far the packages are installed and the service starts at boot; plugging in, saving
and the power cut are untried.
"""
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
LIMIT_S = 240  # a boot with all that happens in it
MASKED = ["apt-daily.timer", "apt-daily-upgrade.timer", "dpkg-db-backup.timer", "e2scrub_all.timer", "e2scrub_reap.service",
          "fstrim.timer", "getty.target", "serial-getty@ttyS0.service", "systemd-logind.service", "systemd-timesyncd.service"]
UNIT = """[Unit]
After=multi-user.target
[Service]
Type=exec
StandardOutput=file:/dev/ttyS1
StandardError=file:/dev/ttyS1
ExecStart=/bin/sh /opt/guest.sh
[Install]
WantedBy=multi-user.target
"""
CONFIGURATION = """[daemon]
control_group = "submapd-operators"
[scanner]
horizontal = "00900001"
vertical = "00900002"
[submap]
path = 3.0
[recorder]
disk_low = 0
disk_last = 0
"""


def skip(why):
    print(f"SKIPPED: vm_test: {why}", file=sys.stderr)
    sys.exit(77)


def make_disk(root, disk):
    units = root / "etc/systemd/system"
    (root / "opt/guest.sh").write_text((HERE / "guest.sh").read_text(encoding="utf-8"), encoding="utf-8")
    (units / "vm-test.service").write_text(UNIT, encoding="utf-8")
    wanted = units / "multi-user.target.wants/vm-test.service"
    wanted.unlink(missing_ok=True)
    wanted.symlink_to("/etc/systemd/system/vm-test.service")
    for name in MASKED:
        (units / name).unlink(missing_ok=True)
        (units / name).symlink_to("/dev/null")
    (root / "etc/submapd/submapd.toml").write_text(CONFIGURATION, encoding="utf-8")
    (root / "etc/fstab").write_text("/dev/vda / ext4 defaults 0 1\n", encoding="utf-8")
    subprocess.run(["mke2fs", "-q", "-t", "ext4", "-d", root, "-E", "root_owner=0:0", disk, "1500M"], check=True)


class Machine:
    def __init__(self, boot, root, disk, port, folder):
        self.result = folder / f"result-{boot}.log"
        self.console = folder / f"console-{boot}.log"
        kernel, = (root / "boot").glob("vmlinuz-*")
        ramdisk, = (root / "boot").glob("initrd.img-*")
        self.qemu = subprocess.Popen([
            "nice", "qemu-system-x86_64", "-accel", "tcg,thread=multi", "-cpu", "max", "-smp", "2", "-m", "768",
            "-display", "none", "-nodefaults", "-no-reboot", "-kernel", kernel, "-initrd", ramdisk,
            "-append", "console=ttyS0 root=/dev/vda rw quiet systemd.firstboot=off systemd.show_status=0 "
                       f"submapd.boot={boot} submapd.port={port}",
            "-drive", f"file={disk},format=raw,if=virtio", "-netdev", "user,id=n", "-device", "virtio-net-pci,netdev=n",
            "-serial", f"file:{self.console}", "-serial", f"file:{self.result}"])

    def said(self):
        return self.result.read_text(encoding="utf-8", errors="replace") if self.result.exists() else ""

    def wait_for(self, words):
        """True if it said these words before it ended."""
        until = time.monotonic() + LIMIT_S
        while time.monotonic() < until:
            if words in self.said():
                return True
            if "FAILED" in self.said() or self.qemu.poll() is not None:
                time.sleep(3)  # for the rest of its message
                return words in self.said()
            time.sleep(0.2)  # a file tells nobody that it grew
        return False

    def cut_the_power(self):
        self.qemu.send_signal(signal.SIGKILL)
        self.qemu.wait()


def boot(number, words, root, disk, port, folder):
    begun = time.monotonic()
    machine = Machine(number, root, disk, port, folder)
    try:
        fine = machine.wait_for(words)
    finally:
        machine.cut_the_power()
    print(f"---- boot {number}, {time.monotonic() - begun:.0f} s; the guest, with its uptime:\n{machine.said()}", flush=True)
    if not fine:
        console = machine.console.read_text(encoding="utf-8", errors="replace") if machine.console.exists() else ""
        sys.exit(f"boot {number} did not come to \"{words}\"; the console's end:\n{console[-3000:]}")


def main():
    packages, sim_program, cache = map(pathlib.Path, sys.argv[1:4])
    if os.geteuid() != 0:
        skip("needs root to make the guest's disk")
    for tool in ("mmdebstrap", "qemu-system-x86_64", "mke2fs"):
        if not shutil.which(tool):
            skip(f"there is no {tool} here (tools/setup installs it)")
    begun = time.monotonic()
    made = subprocess.run([sys.executable, HERE / "make_root.py", packages, cache], stdout=subprocess.PIPE, text=True)
    if made.returncode != 0:
        if not list(cache.glob("base-*.tar")):
            skip("mmdebstrap could not make a Debian: is there a mirror?")
        sys.exit("the packages could not be installed in the clean root")
    root = pathlib.Path(made.stdout.splitlines()[-1])
    with tempfile.TemporaryDirectory(dir=cache) as scratch:
        folder = pathlib.Path(scratch)
        disk = folder / "disk.img"
        make_disk(root, disk)
        print(f"---- the disk is made after {time.monotonic() - begun:.0f} s", flush=True)
        # Slow enough for an emulated processor; the stamps are the host's.
        sim = subprocess.Popen([sim_program, "--front", "usbip", "--usbip-port", "0", "--scanners", "2", "--boot", "0",
                                "--speed", "1"], stdout=subprocess.PIPE, text=True)
        try:
            port = int(sim.stdout.readline().rsplit(":", 1)[1])
            boot(1, "POWER: cut it", root, disk, port, folder)
            boot(2, "PASSED", root, disk, port, folder)
        finally:
            sim.send_signal(signal.SIGTERM)
            sim.wait()
    shutil.rmtree(root)


if __name__ == "__main__":
    main()
