#!/usr/bin/env python3
"""submap-spy under Xvfb with our jar: its window shows every channel with its type, and has decoded the messages.

Usage: spy_test.py SUBMAP_SPY TYPES_JAR SEND_EACH_TYPE PROBE_SOURCE LCM_FOLDER
"""
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time

SPY, JAR, SENDER, PROBE, TYPES = map(pathlib.Path, sys.argv[1:])
NESTED = {"loop_t", "sensor_health_t", "submap_pose_t"}  # parts of others
LCM_JAR = pathlib.Path("/usr/share/java/lcm.jar")
CHART_JAR = pathlib.Path("/usr/share/java/jchart2d.jar")


def skip(why):
    print(f"*** SKIPPED: spy_test: {why} ***", file=sys.stderr)
    sys.exit(77)


def start(words, **more):
    return subprocess.Popen([str(word) for word in words], start_new_session=True, text=True, **more)


def end(process):
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGTERM)
    try:
        process.wait(timeout=10)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


for tool in ("Xvfb", "java", "javac", "jar"):
    if shutil.which(tool) is None:
        skip(f"there is no {tool}")
for path in (JAR, LCM_JAR, CHART_JAR):
    if not path.exists():
        skip(f"there is no {path}")
home = pathlib.Path(shutil.which("java")).resolve().parents[1]
if not list(home.glob("lib/libawt_xawt.so")):
    skip(f"{home} has no windows (default-jre)")

with tempfile.TemporaryDirectory() as name:
    folder = pathlib.Path(name)
    subprocess.run(["javac", "-cp", LCM_JAR, "-d", folder / "classes", PROBE], check=True, timeout=120)
    (folder / "manifest").write_text("Premain-Class: SpyProbe\n")
    subprocess.run(["jar", "--create", "--file", folder / "probe.jar", "--manifest", folder / "manifest", "-C",
                    folder / "classes", "."], check=True, timeout=60)
    shown = folder / "shown"
    running = []
    try:
        # Says on which display it is as soon as it can be used.
        screen = start(["Xvfb", "-displayfd", "1", "-screen", "0", "1200x800x24", "-nolisten", "tcp"],
                       stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        running.append(screen)
        display = screen.stdout.readline().strip()
        assert display, "Xvfb has not started"
        sender = start([SENDER], stdout=subprocess.PIPE)
        running.append(sender)
        messages = open(folder / "messages", "w+", encoding="utf-8")
        spy = start([SPY], stdout=messages, stderr=messages,
                    env={**os.environ, "DISPLAY": f":{display}", "CLASSPATH": str(JAR),
                         "JAVA_TOOL_OPTIONS": f"-javaagent:{folder / 'probe.jar'}={shown}"})
        running.append(spy)

        types = {path.stem for path in TYPES.glob("*.lcm")} - NESTED
        wanted = {}
        while {kind for kind, _ in wanted.values()} != types or len(wanted) < 12:
            line = sender.stdout.readline()
            assert line, f"nothing is sent of {types - {kind for kind, _ in wanted.values()}}"
            channel, kind, utime = line.split()
            wanted[channel] = (kind, utime)
        until = time.monotonic() + 90
        while True:
            lines = [line.split() for line in shown.read_text().splitlines()] if shown.exists() else []
            if len(lines) >= len(wanted):
                break
            assert spy.poll() is None and time.monotonic() < until, (
                f"the spy shows only {lines} and says:\n" + (folder / "messages").read_text())
            time.sleep(0.1)  # it tells nobody
        assert len(lines) == len(wanted), lines
        for channel, in_table, decoded, utime in lines:
            kind, sent = wanted[channel]
            assert (in_table, decoded) == (kind, f"submapd.{kind}"), (channel, in_table, decoded)
            assert utime == sent, (channel, utime, sent)
        assert "Exception" not in (folder / "messages").read_text(), (folder / "messages").read_text()
        print(f"{len(lines)} channels of {len(types)} types decoded")
    finally:
        for process in reversed(running):
            end(process)
