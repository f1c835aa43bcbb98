"""Two emulated scanners, the real libusb and the driver, for as long as asked; then what came is held against the truth.

usage: scanners_soak.py [--seconds S] [--fault-rate R] [--damage-rate R] [--seed N] [--limits] HOKUYO_SIM SCANNERS_SOAK

Prints the figures and fails if
  - a scan says other than what was measured, but for damage inside the alphabet, which a 6-bit sum lets through once in
    63 times (two bytes change; the second must undo the first) and which must be in the emulator's tally;
  - a scan is lost, repeated or dropped without a fault to blame for it, or lost scans and faults are counted wrongly;
  - a true first beam is outside its stated bound while the clock says that no promise it rests on was broken (a host
    busy for seconds breaks them; run it with SCHED_FIFO, as the daemon runs: chrt -f 50).
Latencies and processor time depend on the machine: they are printed, and judged with --limits only. Exit codes: 0 all
well, 1 not.
"""
import argparse
import collections
import json
import os
import subprocess
import sys
import tempfile

LATENCY_P50_MS, LATENCY_P99_MS, PROCESSOR_PERCENT = 0.5, 2.0, 2.0


def percentile(values, share):
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]


def run(options):
    """The emulator's truth, and what the driver's process wrote, by kind of line."""
    with tempfile.TemporaryDirectory() as scratch:
        truth_path = os.path.join(scratch, "truth.jsonl")
        seen_path = os.path.join(scratch, "seen.txt")
        subprocess.run(
            [options.hokuyo_sim, "--scanners", "2", "--boot", "0.5", "--clock-ppm", "40", "--truth", truth_path,
             "--fault-rate", str(options.fault_rate), "--damage-rate", str(options.damage_rate),
             "--seed", str(options.seed), "--",
             options.scanners_soak, "--seconds", str(options.seconds), "--out", seen_path,
             "--transfer-bytes", str(options.transfer_bytes)],
            check=True, timeout=options.seconds + 90)
        with open(truth_path) as file:
            truth = [json.loads(line) for line in file]
        seen = collections.defaultdict(list)
        with open(seen_path) as file:
            for line in file:
                kind, *words = line.split()
                seen[kind].append(words)
    return truth, seen


class Judge:
    def __init__(self, truth, seen):
        self.bad = []
        self.truth = collections.defaultdict(dict)  # by serial, then stamp
        for scan in truth:
            self.truth[scan["serial"]][scan["stamp_ms"]] = scan
        self.seen = seen
        self.damaged_bytes = 0
        self.passed_the_sum = 0

    def judge_values(self):
        for serial, stamp, _, _, ranges_hash in self.seen["scan"]:
            scan = self.truth[serial].get(int(stamp))
            if scan is None:
                self.bad.append(f"{serial}: a scan with stamp {stamp} was never measured")
            elif scan["ranges_hash"] != ranges_hash and scan["faults"] != ["damaged-bytes"]:
                self.bad.append(f"{serial}: the scan with stamp {stamp} is false; faults {scan['faults']}")
            elif set(scan["faults"]) - {"garbage", "damaged-bytes"}:  # garbage before a scan may cost nothing
                self.bad.append(f"{serial}: the damaged scan with stamp {stamp} was taken")
            else:
                self.passed_the_sum += scan["ranges_hash"] != ranges_hash

    def judge_counts(self):
        taken = collections.defaultdict(set)
        for serial, stamp, *_ in self.seen["scan"]:
            taken[serial].add(int(stamp))
        counters = {serial: [int(word) for word in words] for serial, *words in self.seen["counters"]}
        for serial, scans, lost, repeated, dropped in self.seen["total"]:
            print(f"{serial}: {scans} scans, {lost} lost, {repeated} repeated, {dropped} dropped by the ring; "
                  "faults {}, gaps {}, started again {}, quits {}".format(*counters[serial]))
            measured = sorted(self.truth[serial].values(), key=lambda scan: scan["rotation"])
            first, last = min(taken[serial]), max(taken[serial])
            measured = [scan for scan in measured if scan["stamp_ms"] <= last]
            missing = [scan for scan in measured if scan["stamp_ms"] > first and scan["stamp_ms"] not in taken[serial]]
            # A host that is late hears a scan cut in mid-line and the next one without the pause between them.
            cut = {scan["rotation"] for scan in measured if "cut" in scan["faults"]}
            without_fault = sum(not scan["faults"] and scan["rotation"] - 1 not in cut for scan in missing)
            if without_fault or int(repeated) or int(dropped):
                self.bad.append(f"{serial}: {without_fault} undamaged scans are missing, {repeated} came twice, "
                                f"{dropped} were dropped")
            if int(lost) != len(missing):
                self.bad.append(f"{serial}: {len(missing)} scans are missing, but {lost} were counted")
            self.judge_faults(serial, measured, taken[serial], counters[serial][0])

    def judge_faults(self, serial, measured, taken, counted):
        """Each damaged frame is one fault. Random bytes hold a blank line now and then and are two frames then; what comes
        behind a scan cut in mid-line, random bytes or late, is the end of that line."""
        kinds = collections.Counter(kind for scan in measured for kind in scan["faults"])
        passed = sum(scan["faults"] == ["damaged-bytes"] and scan["stamp_ms"] in taken for scan in measured)
        self.damaged_bytes += kinds["damaged-bytes"]
        injected = sum(kinds.values()) - passed
        cut = {scan["rotation"] for scan in measured if "cut" in scan["faults"]}
        least = injected - sum(bool(scan["faults"]) and scan["rotation"] - 1 in cut for scan in measured)
        most = injected + 2 + kinds["garbage"] // 20
        if kinds:
            print(f"{serial}: injected " + ", ".join(f"{kind} {n}" for kind, n in sorted(kinds.items())))
        if not least <= counted <= most:
            self.bad.append(f"{serial}: {counted} faults counted, {least} to {most} were injected")

    def judge_rate(self):
        expected = self.damaged_bytes / 63
        print(f"damage inside the alphabet: {self.damaged_bytes} scans, {self.passed_the_sum} passed, "
              f"{expected:.1f} expected")
        if abs(self.passed_the_sum - expected) > 4 * expected ** 0.5 + 4:
            self.bad.append("not the rate of a 6-bit sum")

    def judge_times(self, limits):
        latencies_ms = []
        for serial, stamp, in_ring in self.seen["ring"]:
            scan = self.truth[serial].get(int(stamp))
            if scan is not None:
                latencies_ms.append(1e-6 * (int(in_ring) - scan["sent_ns"]))
        broken = {serial: int(promises) for serial, _, promises in self.seen["clock"]}
        outside = collections.Counter()
        errors_us = []
        for serial, stamp, first_beam, bound, _ in self.seen["scan"]:
            scan = self.truth[serial].get(int(stamp))
            if scan is not None:
                error_ns = int(first_beam) - scan["first_beam_ns"]
                errors_us.append(1e-3 * error_ns)
                outside[serial] += abs(error_ns) > int(bound)
        for serial, scans in outside.items():
            if scans and not broken[serial]:
                self.bad.append(f"{serial}: {scans} scans outside their time bound, and no promise is said to be broken")
        rms_us = (sum(error * error for error in errors_us) / len(errors_us)) ** 0.5
        p50_ms, p99_ms = percentile(latencies_ms, 0.5), percentile(latencies_ms, 0.99)
        processor = 100 * float(self.seen["cpu"][0][0])
        print(f"last byte sent -> in ring: p50 {p50_ms:.2f} ms, p99 {p99_ms:.2f} ms, "
              f"p99.9 {percentile(latencies_ms, 0.999):.2f} ms, max {max(latencies_ms):.2f} ms")
        print(f"first beam against the truth: RMS {rms_us:.0f} us; " + "; ".join(
            f"{serial}: USB grid {grid} us, promises broken {promises}, scans outside their bound {outside[serial]}"
            for serial, grid, promises in self.seen["clock"]))
        print(f"processor {processor:.2f} % of one core, readers included")
        if limits and (p50_ms > LATENCY_P50_MS or p99_ms > LATENCY_P99_MS or processor > PROCESSOR_PERCENT):
            self.bad.append(f"limits: p50 {LATENCY_P50_MS} ms, p99 {LATENCY_P99_MS} ms, {PROCESSOR_PERCENT} % of a core")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--fault-rate", type=float, default=0.0)
    parser.add_argument("--damage-rate", type=float, default=0.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--limits", action="store_true")
    parser.add_argument("--transfer-bytes", type=int, default=4096)
    parser.add_argument("hokuyo_sim")
    parser.add_argument("scanners_soak")
    options = parser.parse_args()
    judge = Judge(*run(options))
    judge.judge_values()
    judge.judge_counts()
    judge.judge_rate()
    judge.judge_times(options.limits)
    for line in judge.bad[:20]:
        print("FAILED:", line)
    return 1 if judge.bad else 0


sys.exit(main())
