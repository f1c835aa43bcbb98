"""Installs the packages in a copy of this machine that has a systemd of its own, and watches the service there.

The copy is an overlay in memory, booted by systemd-nspawn without a network: nothing of it outlasts the test. What happens
inside is in service_guest.py. usage: service_test.py PACKAGES_FOLDER; exit code 77: not possible here.
"""
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

GUEST = pathlib.Path(__file__).resolve().with_name("service_guest.py")
PAYLOAD = """[Service]
Type=oneshot
StandardOutput=append:/out/messages
StandardError=append:/out/messages
ExecStart={python} {guest} {packages}
ExecStopPost=/bin/sh -c 'echo $SERVICE_RESULT $EXIT_STATUS >/out/result'
ExecStopPost=/bin/sh -c 'journalctl --no-pager -u submapd >/out/journal; systemctl --no-block poweroff'
"""


def skip(why):
    print(f"SKIPPED: service_test: {why}", file=sys.stderr)
    sys.exit(77)


def copy_of_this_machine(scratch):
    subprocess.run(["mount", "-t", "tmpfs", "none", scratch], check=True)
    for name in ("upper", "work", "root", "out"):
        (scratch / name).mkdir()
    done = subprocess.run(["mount", "-t", "overlay", "overlay", "-o",
                           f"lowerdir=/,upperdir={scratch}/upper,workdir={scratch}/work", scratch / "root"])
    if done.returncode != 0:
        skip("this kernel has no overlay file system")
    root = scratch / "root"
    units = root / "etc/systemd/system"
    units.mkdir(parents=True, exist_ok=True)
    # Only this is booted, whatever else the machine has enabled.
    (units / "submapd-test.target").write_text("[Unit]\nWants=submapd-test.service\n", encoding="utf-8")
    (units / "submapd-test.service").write_text(
        PAYLOAD.format(python=sys.executable, guest=GUEST, packages=packages), encoding="utf-8")
    # Containers' images forbid packages to start services.
    (root / "usr/sbin/policy-rc.d").unlink(missing_ok=True)
    # Rebuilding the machine's index of manual pages takes longer than all the rest.
    (root / "var/lib/man-db/auto-update").unlink(missing_ok=True)
    return root


if os.geteuid() != 0:
    skip("needs root")
for tool in ("systemd-nspawn", "dpkg", "umockdev-wrapper", "lcm-logger"):
    if not shutil.which(tool):
        skip(f"there is no {tool} here (tools/setup installs it)")
packages = pathlib.Path(sys.argv[1]).resolve()
if os.environ.get("SUBMAPD_OWN_MOUNTS") != "1":
    if subprocess.run(["unshare", "--mount", "true"], stderr=subprocess.DEVNULL).returncode != 0:
        skip("this machine does not let us make a mount namespace")
    os.environ["SUBMAPD_OWN_MOUNTS"] = "1"
    os.execvp("unshare", ["unshare", "--mount", sys.executable, *sys.argv])

with tempfile.TemporaryDirectory() as folder:
    scratch = pathlib.Path(folder)
    root = copy_of_this_machine(scratch)
    try:
        booted = subprocess.run(
            ["timeout", "-k", "5", "180", "systemd-nspawn", "--quiet", "--keep-unit", "--register=no", "-D", root, "--boot",
             "--private-network", f"--bind={scratch}/out:/out", "systemd.unit=submapd-test.target",
             "systemd.show_status=0"],
            stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace")
        out = {path.name: path.read_text(encoding="utf-8", errors="replace") for path in (scratch / "out").iterdir()}
    finally:
        subprocess.run(["umount", root])
        subprocess.run(["umount", scratch])
print(out.get("messages", ""))
if "result" not in out and "messages" not in out:
    skip(f"systemd-nspawn does not boot here: {booted.stdout[-1000:]} {booted.stderr[-1000:]}")
if out.get("result", "").split() != ["success", "0"]:
    print(f"the test inside ended with {out.get('result')}; the service said:\n{out.get('journal', '')[-6000:]}", file=sys.stderr)
    sys.exit(1)
