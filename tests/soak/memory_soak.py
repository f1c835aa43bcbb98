#!/usr/bin/env python3
"""Feeds submapd hours of driving in virtual time and looks at its resident memory, minute by virtual minute.

Usage: memory_soak.py [--minutes M] [--graph BYTES] SUBMAPCTL SUBMAPD
A small budget of the graph makes it condense early: what then still grows would grow in eight hours.
It must stay below the budgets' sum plus 40 MB; from minute 2 on, in runs of more than an hour from minute 10 on, within 2 %.
Half an hour of the office's tour is simulated; in longer runs a stretch of it is driven again and again
(tests/support/repeated_log.py). Run in a network of its own.
"""
import argparse
import pathlib
import signal
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "support"))
from fed_daemon import FedDaemon, simulate
from repeated_log import repeat

CODE_MB = 40.0
TOUR_MINUTES = 30.0


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=float, default=480.0)
    parser.add_argument("--graph", type=int, default=0)
    parser.add_argument("submapctl")
    parser.add_argument("submapd")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        scratch = pathlib.Path(temporary)
        log = simulate(arguments.submapctl, scratch / "sim", min(arguments.minutes, TOUR_MINUTES))
        if arguments.minutes > TOUR_MINUTES:
            log, seam = repeat(log, scratch / "repeated", arguments.minutes)
            print(seam, flush=True)
        more = "raw = false\n" + (f"[budget]\ngraph = {arguments.graph}\n" if arguments.graph else "")
        rig = FedDaemon(arguments.submapctl, arguments.submapd, scratch / "rig", log, 20.0, more)
        begun = time.monotonic()
        rig.start()
        first_us = None
        rss_mb = {}  # by virtual minute
        ended = False
        while not ended:
            time.sleep(0.2)
            assert rig.process.poll() is None, rig.messages()
            health = rig.health()
            if not health or health["mapper"]["scans"] == 0:
                continue
            ended = health["input_ended"] and health["optimizer"]["submaps"] > health["recorder"]["last_submap"]
            first_us = first_us or health["mapper"]["stamp_us"]
            minute = int((health["mapper"]["stamp_us"] - first_us) / 60e6)
            limit_mb = health["memory"]["budget_bytes"] / 1e6 + CODE_MB
            if minute not in rss_mb or ended:
                print(f"minute {minute}: {health['memory']['rss_bytes'] / 1e6:.1f} MB of {limit_mb:.0f}, "
                      f"{health['optimizer']['submaps']} sub-maps, {health['optimizer']['condensed']} condensed, "
                      f"{health['optimizer']['frozen']} frozen", flush=True)
            rss_mb[minute] = health["memory"]["rss_bytes"] / 1e6
        assert rig.end(signal.SIGTERM) == 0
        last_mb = rss_mb[max(rss_mb)]
        print(f"{arguments.minutes:.0f} minutes in {time.monotonic() - begun:.0f} s, {last_mb:.1f} MB at the end")
        failed = max(rss_mb.values()) > limit_mb
        settled = 10 if max(rss_mb) > 60 else 2
        if max(rss_mb) > settled:
            settled_mb = rss_mb[min(m for m in rss_mb if m >= settled)]
            failed = failed or last_mb > 1.02 * settled_mb
            print(f"{100.0 * (last_mb / settled_mb - 1.0):+.1f} % since minute {settled}")
        return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
