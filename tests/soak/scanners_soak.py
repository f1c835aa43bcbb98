"""Two emulated scanners, the real libusb and the driver, for as long as asked; then what came is held against the truth.

usage: scanners_soak.py [--seconds S] [--fault-rate R] [--seed N] HOKUYO_SIM SCANNERS_SOAK

Prints the figures and fails if a scan is false, or lost or repeated without a fault to blame for it. Times depend on
the machine and are printed, not judged. Exit codes: 0 all well, 1 not.
"""
import argparse
import collections
import json
import os
import subprocess
import sys
import tempfile


def percentile(values, share):
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]


def read_seen(path):
    seen = collections.defaultdict(list)
    with open(path) as file:
        for line in file:
            kind, *words = line.split()
            seen[kind].append(words)
    return seen


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--fault-rate", type=float, default=0.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--transfer-bytes", type=int, default=4096)
    parser.add_argument("hokuyo_sim")
    parser.add_argument("scanners_soak")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        truth_path = os.path.join(scratch, "truth.jsonl")
        seen_path = os.path.join(scratch, "seen.txt")
        subprocess.run(
            [options.hokuyo_sim, "--scanners", "2", "--boot", "0.5", "--clock-ppm", "40", "--truth", truth_path,
             "--fault-rate", str(options.fault_rate), "--seed", str(options.seed), "--",
             options.scanners_soak, "--seconds", str(options.seconds), "--out", seen_path,
             "--transfer-bytes", str(options.transfer_bytes)],
            check=True, timeout=options.seconds + 90)
        with open(truth_path) as file:
            truth = [json.loads(line) for line in file]
        seen = read_seen(seen_path)

    bad = []
    true_scans = {(scan["serial"], scan["stamp_ms"]): scan for scan in truth}
    damaged = sum(1 for scan in truth if scan["faults"])
    for serial, scans, lost, repeated, dropped in seen["total"]:
        print(f"{serial}: {scans} scans, {lost} lost, {repeated} repeated, {dropped} dropped by the ring")
        if options.fault_rate == 0.0 and (int(lost), int(repeated), int(dropped)) != (0, 0, 0):
            bad.append(f"{serial} lost, repeated or dropped scans")
    for serial, *counters in seen["counters"]:
        print(f"{serial}: faults {counters[0]}, gaps {counters[1]}, started again {counters[2]}, quits {counters[3]}")
    latencies_ms = []
    for serial, stamp, in_ring in seen["ring"]:
        scan = true_scans.get((serial, int(stamp)))
        if scan is None:
            bad.append(f"{serial}: a scan with stamp {stamp} was never measured")
        elif set(scan["faults"]) - {"garbage"}:  # which may end in a line feed and then costs nothing
            bad.append(f"{serial}: the damaged scan with stamp {stamp} was taken")
        else:
            latencies_ms.append(1e-6 * (int(in_ring) - scan["sent_ns"]))
    outside = 0
    errors_us = []
    for serial, _, stamp, first_beam, bound in seen["scan"]:
        scan = true_scans.get((serial, int(stamp)))
        if scan is not None:
            error_ns = int(first_beam) - scan["first_beam_ns"]
            errors_us.append(1e-3 * error_ns)
            outside += abs(error_ns) > int(bound)
    if outside:
        bad.append(f"{outside} scans outside their time bound")
    rms_us = (sum(error * error for error in errors_us) / len(errors_us)) ** 0.5
    print(f"last byte sent -> in ring: p50 {percentile(latencies_ms, 0.5):.2f} ms, p99 {percentile(latencies_ms, 0.99):.2f} ms, "
          f"p99.9 {percentile(latencies_ms, 0.999):.2f} ms, max {max(latencies_ms):.2f} ms")
    print(f"first beam against the truth: RMS {rms_us:.0f} us, outside its bound {outside}")
    print(f"damaged scans {damaged}; processor {100 * float(seen['cpu'][0][0]):.2f} % of one core, readers included")
    for line in bad[:20]:
        print("FAILED:", line)
    return 1 if bad else 0


sys.exit(main())
