"""Runs inside the copy of service_test.py, under its systemd: install, serve, hang, upgrade, remove, purge.

usage: service_guest.py PACKAGES_FOLDER
"""
import collections
import ctypes
import grp
import json
import os
import pathlib
import pwd
import signal
import struct
import subprocess
import sys
import time

PACKAGES = sorted(map(str, pathlib.Path(sys.argv[1]).glob("*.deb")))
CONFIGURATION = pathlib.Path("/etc/submapd/submapd.toml")
RUNS = pathlib.Path("/var/lib/submapd/runs")
LIMIT_S = 60

EMULATOR = """[Service]
Type=exec
User=submapd
RuntimeDirectory=emulator
Environment=TMPDIR=/run/emulator
ExecStart=/bin/sh -c 'exec hokuyo-sim --scanners 2 --boot 0 --speed 1 >/run/emulator/environment'
"""
# What the emulated bus needs, and nothing of the sandbox taken away.
DROP_IN = """[Service]
Environment=LD_PRELOAD=libumockdev-preload.so.0
EnvironmentFile=/run/emulator/environment
ReadWritePaths=/run/emulator
"""


def run(*words, code=0, **options):
    done = subprocess.run(list(map(str, words)), capture_output=True, text=True, timeout=LIMIT_S, **options)
    assert code is None or done.returncode == code, (done.args, done.returncode, done.stdout, done.stderr)
    return done


def show(name, unit="submapd.service"):
    return run("systemctl", "show", "--value", "-p", name, unit).stdout.strip()


def wait_for(what, condition, limit_s=LIMIT_S):
    until = time.monotonic() + limit_s
    while time.monotonic() < until:
        found = condition()
        if found:
            return found
        time.sleep(0.1)  # nobody tells
    raise AssertionError(f"waited {limit_s} s for {what}")


def health():
    done = run("submapctl", "health", "--json", code=None)
    return json.loads(done.stdout) if done.stdout.startswith("{") else {}


def process_status():
    lines = pathlib.Path("/proc", show("MainPID"), "status").read_text(encoding="utf-8").splitlines()
    return {key: value.split() for key, value in (line.split(":", 1) for line in lines)}


def is_started_by_its_package():
    # This machine may lack udev.
    run("dpkg", "--ignore-depends=udev", "--install", *PACKAGES)
    assert run("systemctl", "is-enabled", "submapd.service", "submapd-lcm-route.service").stdout.split() == ["enabled"] * 2
    # Type=notify: active means that READY=1 was sent, and there is no scanner far and wide.
    assert show("ActiveState") == "active" and show("SubState") == "running", run("systemctl", "status", "submapd", code=None)
    wait_for("the state in words", lambda: "scanner" in show("StatusText"))
    assert show("NRestarts") == "0"
    for group in ("hokuyo", "submapd-operators"):
        grp.getgrnam(group)
    state = pathlib.Path("/var/lib/submapd").stat()
    assert (state.st_uid, state.st_mode & 0o777) == (pwd.getpwnam("submapd").pw_uid, 0o750)
    assert "239.255.76.67 dev lo" in run("ip", "route").stdout


def has_no_rights_it_does_not_need():
    status = process_status()
    assert set(status["Uid"]) == {str(pwd.getpwnam("submapd").pw_uid)}, status["Uid"]
    assert status["NoNewPrivs"] == ["1"] and status["Seccomp"] == ["2"], status
    for name in ("CapEff", "CapPrm", "CapBnd", "CapAmb"):
        assert int(status[name][0], 16) == 0, (name, status[name])
    inside = ["nsenter", "--target", show("MainPID"), "--mount"]
    for path in ("/usr/sbin/x", "/etc/submapd/x", "/home/x", "/proc/sys/kernel/printk"):
        assert run(*inside, "sh", "-c", f": >{path}", code=None).returncode != 0, f"could write {path}"
    run(*inside, "sh", "-c", ": >/var/lib/submapd/x && rm /var/lib/submapd/x")


def maps_what_the_scanners_see():
    CONFIGURATION.write_text(CONFIGURATION.read_text(encoding="utf-8") +
                             '\n[scanner]\nhorizontal = "00900001"\nvertical = "00900002"\n', encoding="utf-8")
    pathlib.Path("/etc/systemd/system/emulator.service").write_text(EMULATOR, encoding="utf-8")
    folder = pathlib.Path("/etc/systemd/system/submapd.service.d")
    folder.mkdir()
    (folder / "emulated.conf").write_text(DROP_IN, encoding="utf-8")
    run("systemctl", "daemon-reload")
    start_with_scanners()


def stop_with_scanners():
    # One after the other: the emulation does not stand a client that vanishes, nor the client its end.
    run("systemctl", "stop", "submapd.service")
    run("systemctl", "stop", "emulator.service", code=None)


def start_with_scanners():
    stop_with_scanners()
    run("systemctl", "start", "emulator.service")
    said = pathlib.Path("/run/emulator/environment")
    wait_for("the emulator", lambda: said.exists() and said.read_text(encoding="utf-8").strip())
    run("systemctl", "start", "submapd.service")
    wait_for("a map", lambda: health().get("state") == "mapping" and health()["mapper"]["scans"] > 40)


def is_the_operators():
    run("runuser", "-u", "nobody", "-g", "submapd-operators", "--", "submapctl", "save-map", "hall", "--wait")
    saved = list(RUNS.glob("*/maps/hall/MANIFEST"))
    assert len(saved) == 1, saved
    refused = run("runuser", "-u", "nobody", "--", "submapctl", "save-map", "mine", code=None)
    assert refused.returncode == 1 and "be in its group" in refused.stderr, refused


def events(path):
    """Number of events of each channel of an LCM log."""
    found = collections.Counter()
    data = path.read_bytes()
    at = 0
    while at + 28 <= len(data):
        sync, _, _, channel, size = struct.unpack_from(">IqqII", data, at)
        assert sync == 0xEDA1DA01, f"no event at byte {at} of {path}"
        if at + 28 + channel + size > len(data):
            break
        found[data[at + 28:at + 28 + channel].decode()] += 1
        at += 28 + channel + size
    return found


def record(path, url=None):
    return subprocess.Popen(["lcm-logger", "-q", "-f", *([f"--lcm-url={url}"] if url else []), str(path)],
                            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def lcms_own_tools_record_and_play_it():
    log = pathlib.Path("/tmp/cart.lcmlog")
    logger = record(log)
    mapped = health()["mapper"]["scans"]
    wait_for("three seconds of scans", lambda: health()["mapper"]["scans"] > mapped + 120)
    logger.send_signal(signal.SIGINT)
    logger.wait(LIMIT_S)
    heard = events(log)
    assert heard["CART_POSE"] >= 110 and heard["CART_HEALTH"] >= 2, heard
    assert heard["CART_SCAN_H"] >= 25 and heard["CART_SCAN_V"] >= 25, heard

    again = pathlib.Path("/tmp/again.lcmlog")
    other = "udpm://239.255.76.68:7668?ttl=0"
    logger = record(again, other)
    wait_for("lcm-logger", again.exists)
    run("lcm-logplayer", f"--lcm-url={other}", log)
    # lcm-logger writes out what came last only when it ends.
    wait_for("most events", lambda: sum(events(again).values()) > 0.8 * sum(heard.values()))
    logger.send_signal(signal.SIGINT)
    logger.wait(LIMIT_S)
    for channel, count in heard.items():
        assert count * 0.9 <= events(again)[channel] <= count, (channel, events(again), heard)


def a_thread_that_hangs_gets_it_restarted():
    main = show("MainPID")
    # Its workers have the mapper's name, and come after it.
    mapper = min(int(task.name) for task in pathlib.Path("/proc", main, "task").iterdir()
                 if pathlib.Path(task, "comm").read_text(encoding="utf-8").strip() == "mapper")
    libc = ctypes.CDLL(None, use_errno=True)
    seize, interrupt, all_threads = 0x4206, 0x4207, 0x40000000
    for request in (seize, interrupt):
        assert libc.ptrace(request, mapper, None, None) == 0, os.strerror(ctypes.get_errno())
    os.waitpid(mapper, all_threads)  # it stands
    wait_for("the hanging process to go", lambda: os.waitpid(mapper, all_threads | os.WNOHANG)[0] == mapper)
    wait_for("the restart", lambda: show("NRestarts") == "1" and show("ActiveState") == "active")
    assert show("MainPID") != main
    said = run("journalctl", "--no-pager", "-u", "submapd").stdout
    assert "Watchdog timeout" in said and "result 'watchdog'" in said, said


def it_is_restarted_when_killed():
    main = show("MainPID")
    os.kill(int(main), signal.SIGKILL)
    wait_for("the restart", lambda: show("NRestarts") == "2" and show("ActiveState") == "active")
    assert show("MainPID") != main


def a_wrong_configuration_is_told_once():
    good = CONFIGURATION.read_text(encoding="utf-8")
    CONFIGURATION.write_text(good + "nonsense = 1\n", encoding="utf-8")
    run("systemctl", "restart", "submapd.service", code=1)
    assert show("ActiveState") == "failed" and show("NRestarts") == "0", (show("ActiveState"), show("NRestarts"))
    assert 'unknown key "nonsense"' in run("journalctl", "--no-pager", "-u", "submapd").stdout
    CONFIGURATION.write_text(good, encoding="utf-8")
    run("systemctl", "reset-failed", "submapd.service")
    run("systemctl", "start", "submapd.service")


def an_upgrade_keeps_what_was_set():
    before = CONFIGURATION.read_bytes()
    main = show("MainPID")
    run("dpkg", "--ignore-depends=udev", "--install", *PACKAGES, stdin=subprocess.DEVNULL)
    assert CONFIGURATION.read_bytes() == before
    assert show("ActiveState") == "active" and show("MainPID") != main


def it_stops_in_good_order():
    stop_with_scanners()
    assert show("Result") == "success" and show("ExecMainStatus") == "0"


def removed_it_leaves_configuration_and_runs():
    pathlib.Path("/etc/systemd/system/submapd.service.d/emulated.conf").unlink()
    run("systemctl", "daemon-reload")
    run("systemctl", "start", "submapd.service")
    run("dpkg", "--remove", "submapd")
    assert show("ActiveState") != "active" and not pathlib.Path("/usr/sbin/submapd").exists()
    assert CONFIGURATION.exists() and list(RUNS.glob("*/maps/hall/MANIFEST"))


def purged_it_leaves_the_runs_alone():
    said = run("dpkg", "--purge", "submapd")
    assert "are kept" in said.stderr, said
    assert list(RUNS.glob("*/maps/hall/MANIFEST")) and not CONFIGURATION.parent.exists()
    for wants in pathlib.Path("/etc/systemd/system").rglob("submapd*.service"):
        assert not wants.is_symlink(), wants
    run("dpkg", "--purge", *{pathlib.Path(package).name.split("_")[0] for package in PACKAGES} - {"submapd"})
    assert "submapd" not in run("dpkg-query", "-W", "-f", "${Package}\n").stdout


for step in (is_started_by_its_package, has_no_rights_it_does_not_need, a_thread_that_hangs_gets_it_restarted,
             it_is_restarted_when_killed, a_wrong_configuration_is_told_once, maps_what_the_scanners_see, is_the_operators,
             lcms_own_tools_record_and_play_it, an_upgrade_keeps_what_was_set, it_stops_in_good_order,
             removed_it_leaves_configuration_and_runs, purged_it_leaves_the_runs_alone):
    begun = time.monotonic()
    step()
    print(f"{step.__name__.replace('_', ' ')}: {time.monotonic() - begun:.1f} s", flush=True)
