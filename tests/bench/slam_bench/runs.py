"""Logs, runs of the program on them, and the cache that knows which of them are done.

A run's key is a hash of everything that decides its result: the program's bytes (not the commit: a dirty tree is a
program of its own, a commit that changes no code is not), the log, the options, the configuration. A simulated log's
key is the simulator's bytes and its options, a made one's that of the log it is made from and of the scripts that make
it.
Everything is written aside and renamed, so whatever exists is whole and a command that was killed goes on where it was.
"""
import contextlib
import dataclasses
import fcntl
import functools
import gzip
import hashlib
import json
import os
import pathlib
import shutil
import subprocess
import tempfile
import time

from . import carmen_sparse, metrics, surgery

REPLAY_LIMIT_S = 3 * 3600
KEPT = ("map.png", "metrics.json", "report.json")  # of a replay's results
PACKED = ("trajectory.tum", "trajectory_filter.tum")


class NotBuilt(Exception):
    """The program at hand, or the folder of data, does not have what a row asks for."""


class Failed(Exception):
    """A program ended with an error."""


def digest_of(path):
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:16]


@functools.lru_cache(maxsize=None)
def hash_of_file(path):
    """Of a file that does not change while this command runs."""
    return digest_of(path)


def hash_of(value):
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()[:16]


def call(arguments, limit_s, log, answer=None):
    """Runs a program, no longer than we live; its words go into the file `log`, what it prints to stdout into `answer`
    if that is given. Raises Failed."""
    with open(log, "wb") as words, contextlib.ExitStack() as files:
        try:
            status = subprocess.run(["setpriv", "--pdeathsig", "KILL", *map(str, arguments)], stdin=subprocess.DEVNULL,
                                    stdout=files.enter_context(open(answer, "wb")) if answer else words,
                                    stderr=words, timeout=limit_s, check=False).returncode
        except subprocess.TimeoutExpired:
            status = f"none after {limit_s} s"
    if status != 0:
        raise Failed(f"status {status}: {pathlib.Path(log).read_text(errors='replace').strip()[-400:]}")


# --- logs ---------------------------------------------------------------------------------------------------------

@dataclasses.dataclass(frozen=True)
class Recorded:
    """A log of SUBMAPD_DATA."""
    path: str  # below it
    relations: str = ""

    def key(self, tools):
        return hash_of(["recorded", hash_of_file(tools.data(self.path))])

    def make(self, tools, folder):
        source = tools.data(self.path)
        os.symlink(source, folder / ("log" + "".join(pathlib.Path(self.path).suffixes[-2:])))

    def reference_key(self, tools):
        return hash_of_file(tools.data(self.relations))


@dataclasses.dataclass(frozen=True)
class Simulated:
    """submapctl simulate; a world with a dot in its name is a file below SUBMAPD_DATA."""
    world: str
    seed: int
    options: tuple = ()
    format: str = "lcmlog"

    def shortened(self, minutes):
        options = list(self.options)
        if "--minutes" in options:
            del options[options.index("--minutes"):options.index("--minutes") + 2]
        return dataclasses.replace(self, options=(*options, "--minutes", f"{minutes:g}"))

    def key(self, tools):
        plan = hash_of_file(tools.data(self.world)) if "." in self.world else self.world
        return hash_of(["simulated", hash_of_file(tools.simulator), plan, self.seed, self.options, self.format])

    def make(self, tools, folder):
        tools.check_world(self.world, self.options)
        call([tools.simulator, "simulate", tools.world(self.world), "--out", folder / "log", "--seed", self.seed,
              "--format", self.format, *self.options], 3600, folder / "simulate.txt")
        os.rename(folder / "log.truth.tum", folder / "truth.tum")


@dataclasses.dataclass(frozen=True)
class Operated:
    """A simulated log with something done to it (surgery.py)."""
    base: Simulated
    operation: str
    arguments: tuple = ()

    @property
    def seed(self):
        return self.base.seed

    def shortened(self, minutes):
        return dataclasses.replace(self, base=self.base.shortened(minutes))

    def key(self, tools):
        return hash_of(["operated", self.base.key(tools), self.operation, self.arguments,
                        hash_of_file(surgery.__file__)])

    def make(self, tools, folder):
        self.base.make(tools, folder)
        surgery.operate(self.operation, folder, self.seed, *self.arguments)


@dataclasses.dataclass(frozen=True)
class Drifted:
    """A log with corrected poses, made one with odometry that drifts (carmen_sparse.py)."""
    path: str
    seed: int

    def key(self, tools):
        return hash_of(["drifted", hash_of_file(tools.data(self.path)), self.seed,
                        hash_of_file(carmen_sparse.__file__)])

    def make(self, tools, folder):
        carmen_sparse.write_drifted(tools.data(self.path), self.seed, folder / "log.clf", folder / "truth.tum")


# --- programs -----------------------------------------------------------------------------------------------------

class Tools:
    """The programs that are measured, and where the data are."""

    def __init__(self, submapctl, simulator, trials, data_folder, configuration):
        self.submapctl = pathlib.Path(submapctl).resolve()
        self.trials_program = trials  # of the same build, or None
        self.simulator = pathlib.Path(simulator or submapctl).resolve()
        self.data_folder = pathlib.Path(data_folder).resolve() if data_folder else None
        self.configuration = configuration  # {section: {key: value}}: under every run's own
        self.worlds = {}

    def data(self, path):
        if self.data_folder is None:
            raise NotBuilt("no data: SUBMAPD_DATA is not set")
        found = self.data_folder / path
        if not found.exists():
            raise NotBuilt(f"no data: {path}")
        return found

    def trials(self):
        if self.trials_program is None:
            raise NotBuilt("not built: bench_loop_trials")
        return self.trials_program

    def world(self, name):
        return self.data(name) if "." in name else name

    def check_world(self, name, options=()):
        """Raises NotBuilt if the simulator does not know the world or the options. Asks it once each."""
        asked = (name, options)
        if asked not in self.worlds:
            words = [str(self.simulator), "simulate", str(self.world(name)), "--out", "/dev/null/none", *options]
            said = subprocess.run(words, capture_output=True, text=True, check=False, timeout=600)
            # The folder cannot be written: whoever complains about it understood all the rest.
            complaint = (said.stderr.strip() or "fails").splitlines()[0]
            self.worlds[asked] = "" if "/dev/null/none" in complaint else complaint.split(";")[0]
        if self.worlds[asked]:
            raise NotBuilt(f"not built: {self.worlds[asked]}")

    @functools.cached_property
    def replay_help(self):
        return subprocess.run([self.submapctl, "replay", "--help"], capture_output=True, text=True, check=False).stdout


def toml(configuration):
    """Text of {section: {key: bool, number or string}}."""
    lines = []
    for section, keys in sorted(configuration.items()):
        lines.append(f"[{section}]")
        lines += [f"{key} = {json.dumps(value)}" for key, value in sorted(keys.items())]
    return "\n".join(lines) + "\n" if lines else ""


@dataclasses.dataclass(frozen=True)
class Run:
    """One replay of one log."""
    log: object
    options: tuple = ()                # of submapctl replay
    configuration: tuple = ()          # ((section, key, value), ...)
    cost: float = 30.0                 # seconds it is thought to take, until it has been measured
    score: str = "truth"               # truth, relations, parts (of a kidnap), pairs (of sub-maps) or none
    trials: tuple | None = None        # of loops, on its sub-maps: options of bench_loop_trials

    def shortened(self, minutes):
        """The same on a simulated log of so many minutes."""
        if minutes is None or not hasattr(self.log, "shortened"):
            return self
        return dataclasses.replace(self, log=self.log.shortened(minutes))

    def merged(self, tools):
        merged = {section: dict(keys) for section, keys in tools.configuration.items()}
        for section, key, value in self.configuration:
            merged.setdefault(section, {})[key] = value
        return toml(merged)

    def key(self, tools):
        trials = [] if self.trials is None else [hash_of_file(tools.trials()), self.trials]
        return hash_of([hash_of_file(tools.submapctl), self.log.key(tools), self.options, self.merged(tools), *trials])


@dataclasses.dataclass
class Outcome:
    """What is kept of a run that is done."""
    key: str
    folder: pathlib.Path
    metrics: dict
    report: dict
    score: dict
    digests: dict  # of trajectory.tum and graph.g2o
    trials: dict | None = None  # what bench_loop_trials found


# --- cache --------------------------------------------------------------------------------------------------------

class Cache:
    """logs/KEY while needed, truth/KEY.tum.gz, runs/KEY for ever, times.json. Who only reads needs no lock."""

    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        self.lock_file = None
        for name in ("logs", "truth", "runs", "aside", "pictures"):
            (self.folder / name).mkdir(parents=True, exist_ok=True)

    def lock(self):
        """For one command at a time; False if another has it. Removes what a killed one left half done."""
        self.lock_file = open(self.folder / "lock", "wb")
        try:
            fcntl.flock(self.lock_file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        for leftover in (self.folder / "aside").iterdir():
            shutil.rmtree(leftover)
        return True

    def aside(self, name):
        folder = self.folder / "aside" / name
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        return folder

    # Logs.
    def log_path(self, key):
        folder = self.folder / "logs" / key
        found = sorted(p for p in folder.glob("log.*")) if folder.exists() else []
        return found[0] if found else None

    def make_log(self, log, tools):
        key = log.key(tools)
        if self.log_path(key):
            return
        aside = self.aside(f"log-{key}")
        log.make(tools, aside)
        truth = aside / "truth.tum"
        if truth.exists():
            packed = aside / "truth.tum.gz"
            with open(truth, "rb") as source, gzip.open(packed, "wb", compresslevel=6) as target:
                shutil.copyfileobj(source, target)
            os.replace(packed, self.truth_path(key))
            truth.unlink()
        notes = aside / "notes.json"
        if notes.exists():
            os.replace(notes, self.folder / "truth" / f"{key}.json")
        os.rename(aside, self.folder / "logs" / key)

    def drop_log(self, key):
        shutil.rmtree(self.folder / "logs" / key, ignore_errors=True)

    def truth_path(self, log_key):
        return self.folder / "truth" / f"{log_key}.tum.gz"

    def truth(self, log_key):
        return read_packed_tum(self.truth_path(log_key))

    def notes(self, log_key):
        return json.loads((self.folder / "truth" / f"{log_key}.json").read_text())

    # Runs.
    def run_folder(self, key):
        return self.folder / "runs" / key

    def is_done(self, run, tools):
        return self.run_folder(run.key(tools)).exists()

    def make_run(self, run, tools):
        """Replays and scores. The log must be there."""
        key, log_key = run.key(tools), run.log.key(tools)
        aside = self.aside(f"run-{key}")
        options = list(run.options)
        text = run.merged(tools)
        if text:
            (aside / "configuration.toml").write_text(text)
            options += ["--config", aside / "configuration.toml"]
        out = aside / "out"
        begun = time.monotonic()
        call([tools.submapctl, "replay", self.log_path(log_key), "--out", out, *options], REPLAY_LIMIT_S,
             aside / "replay.txt")
        wall_s = time.monotonic() - begun
        digests = {name: digest_of(out / name) for name in ("trajectory.tum", "graph.g2o")}
        for name in PACKED:
            with open(out / name, "rb") as source, gzip.open(aside / (name + ".gz"), "wb", 6) as target:
                shutil.copyfileobj(source, target)
        if run.score == "pairs":
            carmen_sparse.note_submaps(out / "submaps", aside / "submaps.json")
        if run.trials is not None:
            self.try_loops(run, tools, log_key, out, aside)
        for name in KEPT:
            os.rename(out / name, aside / name)
        shutil.rmtree(out)
        (aside / "run.json").write_text(json.dumps(
            {"wall_s": wall_s, "digests": digests, "log": log_key, "options": run.options, "configuration": text,
             "program": hash_of_file(tools.submapctl), "described": repr(run.log)}, indent=1))
        os.rename(aside, self.run_folder(key))

    def try_loops(self, run, tools, log_key, out, aside):
        """Loop trials on a replay's sub-maps, which are not kept."""
        truth = aside / "truth.tum"
        with gzip.open(self.truth_path(log_key), "rb") as source, open(truth, "wb") as target:
            shutil.copyfileobj(source, target)
        call([tools.trials(), out, truth, *run.trials], REPLAY_LIMIT_S, aside / "trials.txt", aside / "trials.json")
        truth.unlink()

    def outcome(self, run, tools):
        """A done run, or None. Scores it if the scripts that score have changed since."""
        key = run.key(tools)
        folder = self.run_folder(key)
        if not folder.exists():
            return None
        about = json.loads((folder / "run.json").read_text())
        metrics_json = json.loads((folder / "metrics.json").read_text())
        report = json.loads((folder / "report.json").read_text())
        scorers = hash_of([hash_of_file(module.__file__) for module in (metrics, carmen_sparse, surgery)] +
                          [run.score, getattr(run.log, "relations", "")])
        try:
            score = json.loads((folder / "score.json").read_text())
        except FileNotFoundError:
            score = {}
        if score.get("scorers") != scorers:
            score = {**self.score(run, tools, about["log"], folder, report), "scorers": scorers}
            aside = folder / "score.json.aside"
            aside.write_text(json.dumps(score, indent=1))
            os.replace(aside, folder / "score.json")
        trials = None if run.trials is None else json.loads((folder / "trials.json").read_text())
        return Outcome(key, folder, metrics_json, report, score, about["digests"], trials)

    def score(self, run, tools, log_key, folder, report):
        if run.score == "none":
            return {}
        estimate = read_packed_tum(folder / "trajectory.tum.gz")
        if run.score == "relations":
            return metrics.against_relations(estimate, metrics.read_relations(tools.data(run.log.relations))) or {}
        truth = self.truth(log_key)
        if run.score == "parts":
            return surgery.score_parts(estimate, truth, self.notes(log_key))
        if run.score == "pairs":
            submaps = json.loads((folder / "submaps.json").read_text())
            return carmen_sparse.score_pairs(estimate, truth, submaps, report)
        return {**(metrics.against_truth(estimate, truth) or {}), **metrics.loops_against_truth(report, truth),
                **metrics.end_against_truth(report, truth),
                "slips": metrics.slips(read_packed_tum(folder / "trajectory_filter.tum.gz"), truth)}

    # Times that earlier runs took, by what they did and not by program.
    def times(self):
        try:
            return json.loads((self.folder / "times.json").read_text())
        except (FileNotFoundError, json.JSONDecodeError):
            return {}

    def note_time(self, what, seconds):
        times = self.times()
        times[what] = seconds
        aside = self.folder / "times.json.aside"
        aside.write_text(json.dumps(times))
        os.replace(aside, self.folder / "times.json")


@functools.lru_cache(maxsize=3)
def read_packed_tum(path):
    with tempfile.NamedTemporaryFile() as unpacked:
        with gzip.open(path, "rb") as source:
            shutil.copyfileobj(source, unpacked)
        unpacked.flush()
        return metrics.read_tum(unpacked.name)
