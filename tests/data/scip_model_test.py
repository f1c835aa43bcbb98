#!/usr/bin/env python3
"""submapctl scip-decode against the model parser of the reference, on random damaged streams.

Usage: scip_model_test.py SUBMAPCTL [STREAMS [SEED]]   The model is in reference/scip_vectors_make.py beside SUBMAPD_DATA.
"""
import json
import os
import pathlib
import random
import subprocess
import sys

if not os.environ.get("SUBMAPD_DATA"):
    print("*** SKIPPED: SUBMAPD_DATA is not set, so nothing is compared with the model parser ***")
    sys.exit(1 if os.environ.get("CI") == "true" else 0)


def load_model():
    path = pathlib.Path(os.environ["SUBMAPD_DATA"]).resolve().parent / "reference" / "scip_vectors_make.py"
    # Encoder and model only: the rest of the file writes the vectors anew.
    source = path.read_text().split("# ---------------------------------------------------------------- vectors")[0]
    model = {"__name__": "scip_model"}
    exec(compile(source, str(path), "exec"), model)  # pylint: disable=exec-used
    return model


MODEL = load_model()
PLAIN = ["BM", "QT", "RS", "RT", "TM0", "TM2", "CR00", "HS0", "SS115200", "DB02", "RB", "ZZ", "SCIP2.0"]
STATUS = ["00", "00", "00", "01", "02", "04", "0E", "0L", "0M", "10", "21", "98", "50", "99"]


def scan_command(rng):
    """A scan command, the number of its beams, and the width of a value."""
    mode, data = rng.choice("MGNH"), rng.choice("DSE")
    micro = mode in "MN" and rng.random() < 0.1
    first = rng.randrange(0, 1000)
    beams = rng.choice([1, 2, 5, 16, 20, 21, 22, 32, 60, 64, 100])
    cluster = rng.choice([0, 1, 1, 1, 2, 3])
    command = ("%" if micro else "") + f"{mode}{data}{first:04d}{first + beams - 1:04d}{cluster:02d}"
    if mode in "MN":
        command += f"{rng.randrange(0, 3)}{rng.choice([0, 0, 3]):02d}"
    if rng.random() < 0.2:
        command += ";" + rng.choice(["a", "abc", "0123456789abcdef"])
    return command, -(-beams // max(1, cluster)), 2 if data == "S" else 3


def scan_frame(rng, command, beams, width, status):
    top = 64 ** width
    name = command.lstrip("%")
    if name[0] in "NH":
        counts = [rng.choice([1, 1, 2, 3]) for _ in range(beams)]
        ranges = [[rng.randrange(top) for _ in range(n)] for n in counts]
        strengths = [[rng.randrange(top) for _ in range(n)] for n in counts]
    else:
        ranges = [rng.randrange(top) for _ in range(beams)]
        strengths = [rng.randrange(top) for _ in range(beams)]
    micro = command.startswith("%")
    echo = command
    if status == "99" and rng.random() < 0.2:  # the count of scans still to come
        head, _, tag = command.partition(";")
        echo = head[:-2] + f"{rng.randrange(100):02d}" + (";" + tag if tag else "")
    return MODEL["scan"](echo, rng.randrange(64 ** (10 if micro else 4)), ranges, strengths if name[1] == "E" else None,
                         w=width, status=status, tn=11 if micro else 4)


def reply(rng, command, geometry):
    """Bytes that answer one command."""
    if geometry:
        beams, width = geometry
        if command.lstrip("%")[0] in "GH":
            return scan_frame(rng, command, beams, width, "00")
        out = b"" if rng.random() < 0.1 else MODEL["simple"](command, "00")
        for _ in range(rng.randrange(4)):
            if rng.random() < 0.1:
                out += MODEL["simple"](command, rng.choice(STATUS))
            else:
                out += scan_frame(rng, command, beams, width, "99")
        return out
    if command[:2] in ("VV", "PP", "II") and rng.random() < 0.9:
        keys = [("MODL", "UTM-30LX"), ("TIME", "j;o["), ("SCSP", "Initial(2400)<-Default"), ("DMIN", "23"), ("STAT", "")]
        return MODEL["params"](command, rng.sample(keys, rng.randrange(1, 5)))
    if "TM1" in command and rng.random() < 0.9:
        micro = command.startswith("%")
        return MODEL["timeresp"](command, rng.randrange(64 ** 4), 11 if micro else 4)
    return MODEL["simple"](command, rng.choice(STATUS))


def damage(rng, data):
    data = bytearray(data)
    for _ in range(rng.choice([0, 1, 1, 2, 3, 8])):
        if not data:
            break
        at = rng.randrange(len(data))
        kind = rng.randrange(10)
        if kind == 0:
            data[at] = rng.randrange(256)
        elif kind == 1:
            data[at] ^= 1 << rng.randrange(8)
        elif kind == 2:
            del data[at]
        elif kind == 3:
            del data[at:at + rng.choice([64, 66, 128, 512])]
        elif kind == 4:
            data[at:at] = data[at:at + rng.choice([64, 66, 132])]
        elif kind == 5:
            data[at:at] = bytes(rng.randrange(256) for _ in range(rng.randrange(1, 200)))
        elif kind == 6:
            data[at:at] = rng.choice([b"\n", b"\n\n", b"\r", b"&", b"\0"])
        elif kind == 7:
            del data[at:]
        elif kind == 8:
            lines = data.find(b"\n", at)
            if lines >= 0:
                del data[lines]
        else:
            data[at:at + 2] = reversed(data[at:at + 2])
    return bytes(data)


def stream(rng):
    sent, rx = [], b""
    for _ in range(rng.randrange(1, 7)):
        kind = rng.random()
        geometry = None
        if kind < 0.5:
            command, beams, width = scan_command(rng)
            geometry = beams, width
        elif kind < 0.65:
            command = rng.choice(["VV", "PP", "II"])
        elif kind < 0.8:
            command = rng.choice(["TM1", "TM1;a", "%TM1"])
        else:
            command = rng.choice(PLAIN)
        if command not in sent:
            sent.append(command)
            rx += reply(rng, command, geometry)
        if rng.random() < 0.2 and geometry and command.lstrip("%")[0] in "MN":  # scans after others' replies
            sent.append("QT")
            rx += MODEL["simple"]("QT", "00") + scan_frame(rng, command, *geometry, "99")
    return sent, damage(rng, rx)


def more_echoes_than_three(events):
    """The model counts no echoes; a sensor sends three of a beam at most, and so the parser calls more a bad count."""
    return any(len(beam) > 3 for event in events for beam in event.get("echoes", []))


def main():
    submapctl = sys.argv[1]
    streams = int(sys.argv[2]) if len(sys.argv) > 2 else 1500
    seed = int(sys.argv[3]) if len(sys.argv) > 3 else 1
    faults = {}
    compared = 0
    for number in range(streams):
        rng = random.Random(seed * 1_000_003 + number)
        sent, rx = stream(rng)
        expected = MODEL["run"](sent, rx)
        if more_echoes_than_three(expected):
            continue
        options = [option for command in sent for option in ("--tx", command)]
        result = subprocess.run([submapctl, "scip-decode", *options], input=rx, capture_output=True, check=False, timeout=60)
        assert result.returncode == 0, (sent, result.stderr)
        events = [json.loads(line) for line in result.stdout.decode("ascii").splitlines()]
        if events != expected:
            first = next((i for i, (a, b) in enumerate(zip(events, expected)) if a != b), min(len(events), len(expected)))
            print(f"stream {number} of seed {seed}: differs from event {first} on\n  sent {sent}\n  rx {rx!r}")
            print("  ours ", events[first:first + 2], "\n  model", expected[first:first + 2])
            sys.exit(1)
        compared += 1
        for event in events:
            name = event["ev"] + (":" + event["class"] if event["ev"] == "fault" else "")
            faults[name] = faults.get(name, 0) + 1
    print(f"seed {seed}: {compared} streams agree with the model; events {dict(sorted(faults.items()))}")
    # A comparison that never saw an event of each kind proves little.
    missing = [name for name in ("ack", "scan", "stale_scan", "reply", "time", "stream_status", "fault:bad_sum", "fault:bad_char",
                                 "fault:bad_echo", "fault:bad_line", "fault:bad_count", "fault:oversize_line",
                                 "fault:missing_terminator", "fault:truncated", "fault:bad_status", "fault:bad_param")
               if name not in faults]
    assert streams < 500 or not missing, f"never seen: {missing}"


main()
