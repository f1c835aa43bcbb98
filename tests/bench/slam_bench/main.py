"""tests/bench/slam: command line, and from the rows to the table."""
import argparse
import os
import pathlib
import shutil
import subprocess
import sys
import tomllib

from . import page, quality, rows, work
from .runs import Cache, NotBuilt, Tools, hash_of_file

TOP = pathlib.Path(__file__).resolve().parents[3]
README = TOP / "tests" / "bench" / "README.md"
README_HEAD = "| row | kind | figure | median | worst (seed) | must | goal | | runs | measured at |"
QUALITY_HEAD = "| figure of report.json | rank correlation with the RMSE | runs |"
FEWEST_RUNS = 10  # that a rank correlation is told of

EPILOG = """Kill it at any time and start it again: only what is missing is run. A run is known by the bytes of the
program, the log, options and configuration. Logs are dropped when all runs on them are done; truth,
trajectories, pictures and figures stay in the cache (SUBMAPD_BENCH_CACHE, else ~/.cache/submapd-bench).
Recorded logs and plans are in SUBMAPD_DATA. Exit status: 0, also if a row misses what it must show; 1 if a
run failed; 2 for bad usage; 75 if another one is at work."""


def default_cache():
    return pathlib.Path(os.environ.get("XDG_CACHE_HOME") or pathlib.Path.home() / ".cache") / "submapd-bench"


def arguments_of(words):
    parser = argparse.ArgumentParser(prog="tests/bench/slam", epilog=EPILOG,
                                     description="Runs the rows of the SLAM benchmark and prints their table.",
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", action="append", metavar="PATTERN", default=[],
                        help="only rows whose names match, with * and ?; commas or more than once for several")
    parser.add_argument("--seeds", type=int, metavar="N",
                        help="at most this many seeds a row (default: each row's own)")
    parser.add_argument("--minutes", type=float, metavar="M",
                        help="simulate so long instead of what the rows ask for: a first look, not the table")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="logs worked on at once (default 1)")
    parser.add_argument("--list", action="store_true", help="list the rows and what of them is done, and run nothing")
    parser.add_argument("--table", action="store_true", help="print the table of what is done, and run nothing")
    parser.add_argument("--submapctl", metavar="FILE", type=pathlib.Path,
                        default=TOP / "build" / "release" / "tools" / "submapctl" / "submapctl",
                        help="program to measure (default: that of the release preset)")
    parser.add_argument("--simulator", metavar="FILE", type=pathlib.Path,
                        help="submapctl that makes the simulated logs (default: the one that is measured)")
    parser.add_argument("--config", metavar="FILE", type=pathlib.Path, help="configuration under all runs")
    parser.add_argument("--cache", metavar="DIR", type=pathlib.Path,
                        default=os.environ.get("SUBMAPD_BENCH_CACHE") or default_cache(), help="where results are kept")
    parser.add_argument("--keep-logs", action="store_true", help="keep simulated logs: up to 100 MB each")
    parser.add_argument("--readme", action="store_true", help="write the rows into tests/bench/README.md")
    arguments = parser.parse_args(words)
    arguments.rows = [p for pattern in arguments.rows for p in pattern.split(",") if p]
    if arguments.readme and (arguments.minutes or arguments.config):
        parser.error("--readme is for the rows as they are: without --minutes and --config")
    if arguments.jobs < 1 or (arguments.seeds is not None and arguments.seeds < 1):
        parser.error("--jobs and --seeds must be at least 1")
    for program in (arguments.submapctl, arguments.simulator):
        if program is not None and not program.is_file():
            parser.error(f"{program}: no such program; build the release preset's target submapctl, or give another")
    if not rows.rows_like(arguments.rows):
        parser.error(f"no row is named like {', '.join(arguments.rows)}; see --list")
    return arguments


def own_copy(program, cache):
    """The program as it is now: a build in the meantime changes nothing."""
    target = cache.folder / "programs" / hash_of_file(program) / program.name
    if not target.exists():
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(program, target.with_name("aside"))
        os.replace(target.with_name("aside"), target)
    return target


def trials_beside(submapctl):
    """bench_loop_trials of the build that submapctl is of, or None."""
    program = submapctl.resolve().parent / "../../tests/bench/bench_loop_trials"
    return program if program.is_file() else None


def commit():
    def git(*words):
        return subprocess.run(["git", "-C", TOP, *words], capture_output=True, text=True, check=False).stdout.strip()
    dirty = git("status", "--porcelain", "--untracked-files=no", "--", "slam", "driver", "proto", "daemon", "tools")
    return (git("rev-parse", "--short=9", "HEAD") or "unknown") + ("+" if dirty else "")


def seeds_of(row, most):
    return range(1, min(row.seeds, most or row.seeds) + 1)


def runs_of(row, arguments):
    """[(seed, name for people, name within the row, Run)]"""
    if row.missing:
        return []
    cut = "" if arguments.minutes is None else f" {arguments.minutes:g} min"
    return [(seed, f"{row.name} seed {seed}" + (f" {name}" if name != "run" else "") + cut, name,
             run.shortened(arguments.minutes))
            for seed in seeds_of(row, arguments.seeds) for name, run in row.runs(seed).items()]


def problem_of(run, tools, impossible, failures):
    if run in impossible:
        return impossible[run]
    try:
        return "FAILED: " + failures[run.key(tools)] if run.key(tools) in failures else "not run"
    except NotBuilt as problem:
        return str(problem)


class Table:
    """What is done of the selected rows."""

    def __init__(self, selected, arguments, cache, tools, impossible, failures):
        self.lines, self.outcomes, self.complete = [], {}, set()
        for row in selected:
            by_seed, problem = {}, f"not built: {row.missing}" if row.missing else ""
            for seed in seeds_of(row, arguments.seeds):
                found = {}
                runs = [(label, name, run) for s, label, name, run in runs_of(row, arguments) if s == seed]
                for label, name, run in runs:
                    outcome = None
                    if run not in impossible:
                        outcome = cache.outcome(run, tools)
                    if outcome is None:
                        problem = problem_of(run, tools, impossible, failures)
                        break
                    found[name] = outcome
                    self.outcomes[label] = (row, run, outcome)
                else:
                    if runs:
                        by_seed[seed] = found
            self.lines += page.lines_of(row, by_seed, problem)
            if by_seed or (problem and problem != "not run"):
                self.complete.add(row.name)

    def pictures(self, folder):
        """Links to the maps under names for people; a run of several rows has that of the first."""
        shown = set()
        for label, (_, _, outcome) in self.outcomes.items():
            if outcome.key in shown:
                continue
            shown.add(outcome.key)
            target = folder / (label.replace(" ", "-").replace("=", "") + ".png")
            target.unlink(missing_ok=True)
            os.link(outcome.folder / "map.png", target)

    def simulated(self):
        """Distinct runs with an exact truth and the whole program."""
        return list({o.key: o for row, run, o in self.outcomes.values() if row.simulated and
                     run.score in ("truth", "parts") and not row.name.startswith(("ablation", "single-map"))}.values())


def print_slips(table):
    """Of the runs of rows that miss something: where tracking went wrong."""
    missed = {line.row for line in table.lines if "MISSED" in line.cells}
    shown = set()
    for label, (row, _, outcome) in table.outcomes.items():
        slips = outcome.score.get("slips") or []
        if row.name not in missed or not slips or outcome.key in shown:
            continue
        shown.add(outcome.key)
        x, y = outcome.score["worst_at_m"]
        print(f"{label}: worst point {outcome.score['worst_m']:.3f} m off at {outcome.score['worst_at_s']:.1f} s, "
              f"({x}, {y}); slips:")
        for slip in slips:
            print("    " + slip)


def print_quality(found):
    print("\nreport.json against the true RMSE of the simulated runs (Spearman):")
    for name, value, runs in found:
        print(f"  {name:30} {shown(value):>6} over {runs} runs")


def shown(correlation):
    return "-" if correlation is None else f"{correlation:+.2f}"


def main(words):
    arguments = arguments_of(words)
    cache = Cache(arguments.cache)
    if not (arguments.list or arguments.table or cache.lock()):
        print(f"tests/bench/slam: {arguments.cache}: another one is at work there", file=sys.stderr)
        return 75
    configuration = {}
    if arguments.config:
        try:
            configuration = tomllib.loads(arguments.config.read_text(encoding="utf-8"))
        except (OSError, tomllib.TOMLDecodeError) as problem:
            print(f"tests/bench/slam: {arguments.config}: {problem}", file=sys.stderr)
            return 2
    trials = trials_beside(arguments.submapctl)
    tools = Tools(own_copy(arguments.submapctl, cache),
                  own_copy(arguments.simulator, cache) if arguments.simulator else None,
                  own_copy(trials, cache) if trials else None, os.environ.get("SUBMAPD_DATA"), configuration)
    selected = rows.rows_like(arguments.rows)
    wanted = [(label, run) for row in selected for _, label, _, run in runs_of(row, arguments)]
    jobs, impossible = work.plan(wanted, cache, tools)
    if arguments.list:
        for row in selected:
            runs = [run for _, _, _, run in runs_of(row, arguments)]
            reasons = sorted({impossible[run] for run in runs if run in impossible})
            done = sum(run not in impossible and cache.is_done(run, tools) for run in runs)
            state = reasons[0] if reasons else f"{done} of {len(runs)} runs done"
            if row.missing:
                state = f"not built: {row.missing}"
            print(f"{row.name:20} {row.what:70} {state}")
        return 0
    failures = {}
    if not arguments.table:
        try:
            failures = work.execute(jobs, cache, tools, arguments.jobs, arguments.keep_logs)
        except KeyboardInterrupt:
            print("interrupted: start again to go on", file=sys.stderr, flush=True)
            os._exit(130)  # at once: the programs that run die with us
    table = Table(selected, arguments, cache, tools, impossible, failures)
    table.pictures(cache.folder / "pictures")
    page.print_lines(table.lines)
    print()
    print_slips(table)
    found = quality.correlations(table.simulated())
    if max(runs for _, _, runs in found) >= FEWEST_RUNS:
        print_quality(found)
    print(f"\npictures: {cache.folder / 'pictures'}")
    if arguments.readme:
        write_readme(table, found)
    return 1 if failures else 0


def write_readme(table, found):
    kinds = {row.name: "simulated" if row.simulated else "recorded" for row in rows.ROWS}
    fresh = page.markdown([line for line in table.lines if line.row in table.complete], kinds, commit())
    unknown = page.markdown([page.lines_of(row, {}, f"not built: {row.missing}" if row.missing else "")[0]
                             for row in rows.ROWS], kinds, "")
    page.rewrite(README, "table", fresh, [row.name for row in rows.ROWS], README_HEAD, unknown)
    if max(runs for _, _, runs in found) >= FEWEST_RUNS:
        lines = {name: [f"| `{name}` | {shown(value)} | {runs} |"] for name, value, runs in found}
        page.rewrite(README, "quality", lines, list(lines), QUALITY_HEAD)
