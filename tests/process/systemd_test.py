"""Has systemd judge the shipped files. usage: systemd_test.py SYSTEMD_FOLDER SUBMAPD; exit code 77: no systemd here."""
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

FOLDER = pathlib.Path(sys.argv[1])
SUBMAPD = sys.argv[2]


def run(*words):
    return subprocess.run(list(map(str, words)), capture_output=True, text=True, timeout=60)


def units_are_verified_without_a_word(scratch):
    for name in ("submapd.service", "submapd-lcm-route.service"):
        text = (FOLDER / name).read_text(encoding="utf-8")
        (scratch / name).write_text(text.replace("/usr/sbin/submapd", SUBMAPD), encoding="utf-8")
    # Each by its path: together they find each other.
    done = run("systemd-analyze", "verify", "--man=no", scratch / "submapd.service", scratch / "submapd-lcm-route.service")
    assert done.returncode == 0, done
    ours = [line for line in (done.stdout + done.stderr).splitlines() if "submapd" in line]
    assert not ours, ours


def the_sandbox_is_tight(scratch):
    done = run("systemd-analyze", "security", "--offline=true", "--threshold=20", scratch / "submapd.service")
    assert done.returncode == 0, done.stdout[-500:] + done.stderr


def scanners_may_come_after_the_kernels_usb():
    """systemd looks a group of devices up once, when the service starts: no usbcore then, no scanner ever."""
    allowed = re.findall(r"^DeviceAllow=(\S+)", (FOLDER / "submapd.service").read_text(encoding="utf-8"), re.MULTILINE)
    assert "char-189" in allowed and "char-usb_device" not in allowed, allowed


def users_and_folders_are_made(scratch):
    root = scratch / "root"
    (root / "etc").mkdir(parents=True)
    for kind in ("sysusers", "tmpfiles"):
        place = root / f"usr/lib/{kind}.d"
        place.mkdir(parents=True)
        shutil.copy(FOLDER / f"submapd-{kind}.conf", place / "submapd.conf")
    done = run("systemd-sysusers", f"--root={root}")
    assert done.returncode == 0, done
    groups = (root / "etc/group").read_text(encoding="utf-8")
    for group in ("submapd:", "hokuyo:", "submapd-operators:", "input:"):
        assert group in groups, groups
    state = root / "var/lib/submapd/runs/R"
    for left in ("submaps/.000001.submap.7.0.tmp", "maps/.hall.abcdef/map.pgm", "maps/hall/map.pgm"):
        (state / left).parent.mkdir(parents=True, exist_ok=True)
        (state / left).write_text("x", encoding="utf-8")
    done = run("systemd-tmpfiles", f"--root={root}", "--create", "--remove", "--boot")
    assert done.returncode == 0, done
    kept = sorted(str(path.relative_to(state)) for path in state.rglob("*") if path.is_file())
    assert kept == ["maps/hall/map.pgm"], kept


if not shutil.which("systemd-analyze"):
    print("SKIPPED: there is no systemd-analyze here", file=sys.stderr)
    sys.exit(77)
with tempfile.TemporaryDirectory() as folder:
    units_are_verified_without_a_word(pathlib.Path(folder))
    the_sandbox_is_tight(pathlib.Path(folder))
    scanners_may_come_after_the_kernels_usb()
    users_and_folders_are_made(pathlib.Path(folder))
