"""submapctl sensors and hokuyo-sim as whole programs: emulated scanners behind the real libusb, and at terminals.

usage: sensors_test.py HOKUYO_SIM SUBMAPCTL
"""
import json
import os
import signal
import subprocess
import sys
import tempfile
import termios
import time
import tty

HOKUYO_SIM, SUBMAPCTL = sys.argv[1:3]
LIMIT_S = 60


def run(*words):
    return subprocess.run(words, capture_output=True, text=True, timeout=LIMIT_S)


def survey(*options, config):
    done = run(HOKUYO_SIM, *options, "--boot", "0.3", "--", SUBMAPCTL, "sensors", "--json", "--config", config)
    assert done.returncode == 0, done
    return json.loads(done.stdout)


def two_scanners_are_listed_and_assigned(config):
    found = survey("--scanners", "2", "--serial", "00903971", "--serial", "00900001", config=config)
    assert [(s["port"], s["serial"]) for s in sorted(found, key=lambda s: s["port"])] == [
        ("1-1", "00903971"), ("1-2", "00900001")], found
    for scanner in found:
        assert scanner["product"] == "SOKUIKI Sensor TOP-URG UTM-30LX", scanner
        assert scanner["state"] == "streaming", scanner
        assert scanner["role"] is None, scanner
        assert 39.0 < scanner["rate_hz"] < 41.0, scanner

    done = run(SUBMAPCTL, "sensors", "--config", config, "--assign", "H=H0903971", "V=00900001")
    assert done.returncode == 0, done
    found = survey("--scanners", "2", "--serial", "00903971", "--serial", "00900001", config=config)
    assert {s["serial"]: s["role"] for s in found} == {"00903971": "H", "00900001": "V"}, found


def a_self_test_is_a_command(config):
    command = [HOKUYO_SIM, "--serial", "00903971", "--boot", "0.3", "--", SUBMAPCTL, "sensors", "--json", "--config",
               config, "--self-test"]
    done = run(*command, "H0903971")
    assert done.returncode == 0, done
    test = json.loads(done.stdout)[0]["self_test"]
    assert test == {"passed": True, "scans": 100, "damaged": 0, "lost": 0}, test
    done = run(*command[:1], "--fault", "garbled-sum@1", *command[1:], "00903971")
    assert done.returncode == 1 and json.loads(done.stdout)[0]["self_test"]["damaged"] == 1, done
    done = run(*command, "123")
    assert done.returncode == 1 and "no such scanner" in done.stderr, done
    assert json.loads(done.stdout)[0]["self_test"] is None, done


def no_scanner_is_no_error(config):
    done = run("umockdev-wrapper", SUBMAPCTL, "sensors", "--config", config)
    assert done.returncode == 0 and "no scanner is plugged in" in done.stderr, done


def nonsense_is_refused(config):
    for words in (["--assign", "V=1"], ["--assign", "H=1", "V=1"], ["--wait", "-1"]):
        done = run(SUBMAPCTL, "sensors", "--config", config, *words)
        assert done.returncode == 2, done
    for words in (["--fault", "sulk@1"], ["--fault", "2:stall@1"], ["--scanners", "9"], ["--world", "no-such.csv"]):
        done = run(HOKUYO_SIM, *words)
        assert done.returncode == 2 and done.stderr, done


def the_childs_exit_code_is_passed_on():
    assert run(HOKUYO_SIM, "--", "sh", "-c", "exit 7").returncode == 7


def truth_is_told_for_each_scan(folder, config):
    truth = os.path.join(folder, "truth.jsonl")
    survey("--truth", truth, "--fault", "garbled-sum@0.5", config=config)
    with open(truth) as file:
        scans = [json.loads(line) for line in file]
    assert len(scans) > 30
    assert [s["faults"] for s in scans if s["faults"]] == [["garbled-sum"]]
    steps = {b["first_beam_ns"] - a["first_beam_ns"] for a, b in zip(scans, scans[1:])}
    assert steps == {25000000}, steps


def a_terminal_speaks_scip():
    sim = subprocess.Popen([HOKUYO_SIM, "--front", "pty", "--boot", "0", "--serial", "00903971"],
                           stdout=subprocess.PIPE, text=True)
    try:
        serial, path = sim.stdout.readline().split()
        assert serial == "00903971"
        line = os.open(path, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(line, termios.TCSANOW)
        os.write(line, b"VV\nMD0000108001002\n")
        heard = b""
        end = time.monotonic() + LIMIT_S
        while heard.count(b"\n99b\n") < 2 and time.monotonic() < end:
            heard += os.read(line, 4096)
        os.close(line)
        assert b"SERI:00903971;:" in heard, heard[:300]
        assert heard.count(b"\n99b\n") == 2
    finally:
        sim.send_signal(signal.SIGTERM)
        assert sim.wait(LIMIT_S) == 0


with tempfile.TemporaryDirectory() as scratch:
    file_name = os.path.join(scratch, "submapd.toml")
    two_scanners_are_listed_and_assigned(file_name)
    a_self_test_is_a_command(file_name)
    no_scanner_is_no_error(file_name)
    nonsense_is_refused(file_name)
    truth_is_told_for_each_scan(scratch, file_name)
the_childs_exit_code_is_passed_on()
a_terminal_speaks_scip()
