"""The packages on a real Debian machine: QEMU, Debian's kernel, udev, two scanners plugged in over USB/IP, a power cut.

usage: vm_test.py PACKAGES_FOLDER CACHE_FOLDER; exit code 77: not possible here.

The power cut is a SIGKILL to QEMU; the disk, ext4 with its journal, is kept and booted again. What happens inside is in
guest.sh, what all this shows in README.md.
"""
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time

TOOLS = ("mmdebstrap", "qemu-system-x86_64", "mke2fs", "setpriv")
HERE = pathlib.Path(__file__).resolve().parent
LIMIT_S = 550  # a boot with all that happens in it
DRIVE_MINUTES = "1"
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
    # Ranges that are recorded, not computed: an emulated processor has better things to do.
    subprocess.run(["chroot", root, "submapctl", "simulate", "office", "--out", "/opt/drive", "--format", "lcmlog",
                    "--minutes", DRIVE_MINUTES, "--speed", "1"], check=True)
    (root / "etc/fstab").write_text("/dev/vda / ext4 defaults 0 1\n", encoding="utf-8")
    subprocess.run(["mke2fs", "-q", "-t", "ext4", "-d", root, "-E", "root_owner=0:0", disk, "1500M"], check=True)


class Machine:
    def __init__(self, boot, root, disk, folder):
        self.result = folder / f"result-{boot}.log"
        self.console = folder / f"console-{boot}.log"
        kernel, = (root / "boot").glob("vmlinuz-*")
        ramdisk, = (root / "boot").glob("initrd.img-*")
        self.qemu = subprocess.Popen([
            # icount: the guest's time is the number of its instructions, 1 ns each, and idle time is skipped. So a machine
            # that is busy makes the test slow, but no scan late.
            "setpriv", "--pdeathsig", "KILL", "qemu-system-x86_64", "-accel", "tcg", "-icount", "shift=0,sleep=off", "-cpu", "max", "-smp", "1", "-m", "768",
            "-display", "none", "-nodefaults", "-no-reboot", "-kernel", kernel, "-initrd", ramdisk,
            "-append", "console=ttyS0 root=/dev/vda rw quiet systemd.firstboot=off systemd.show_status=0 "
                       f"submapd.boot={boot}",
            "-drive", f"file={disk},format=raw,if=virtio",
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
        self.qemu.kill()
        self.qemu.wait()


def boot(number, words, root, disk, folder):
    """What the guest said."""
    begun = time.monotonic()
    machine = Machine(number, root, disk, folder)
    try:
        fine = machine.wait_for(words)
    finally:
        machine.cut_the_power()
    said = machine.said()
    print(f"---- boot {number}, {time.monotonic() - begun:.0f} s; the guest, with its uptime:\n{said}", flush=True)
    if not fine:
        console = machine.console.read_text(encoding="utf-8", errors="replace") if machine.console.exists() else ""
        sys.exit(f"boot {number} did not come to \"{words}\"; the console's end:\n{console[-3000:]}")
    return said


def nothing_is_lost(before, after):
    def kept(said):
        return set(re.findall(r"KEPT (\S+ +\S+)", said))

    def raw_bytes(said):
        return int(re.search(r"RAW (\d+)", said).group(1))

    lost = kept(before) - kept(after)
    assert len(kept(before)) >= 3 and not lost, f"lost or changed: {lost}"
    assert raw_bytes(after) >= raw_bytes(before), f"{raw_bytes(before)} bytes of scans were recorded, {raw_bytes(after)} are left"


def main():
    packages, cache = map(pathlib.Path, sys.argv[1:3])
    missing = [tool for tool in TOOLS if not shutil.which(tool)]
    if missing:
        skip(f"there is no {' and no '.join(missing)} here; tools/setup --vm installs what it needs")
    if os.geteuid() != 0:
        skip("needs root to make the guest's disk")
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
        before = boot(1, "POWER: cut it", root, disk, folder)
        after = boot(2, "PASSED", root, disk, folder)
        nothing_is_lost(before, after)
    shutil.rmtree(root)
    print(f"---- {time.monotonic() - begun:.0f} s in all")


if __name__ == "__main__":
    main()
