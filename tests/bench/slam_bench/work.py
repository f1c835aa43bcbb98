"""Does what is missing: makes each log once, replays all runs on it, drops it."""
import concurrent.futures
import dataclasses
import sys
import threading
import time

from .runs import Failed, NotBuilt


@dataclasses.dataclass
class Job:
    """All missing runs on one log."""
    log: object
    log_key: str
    runs: dict  # key: (name, Run)


def plan(wanted, cache, tools):
    """(jobs, {run key: why it cannot be}) of [(name, Run)]. The order is that of the rows."""
    jobs, impossible = {}, {}
    for name, run in wanted:
        try:
            key = run.key(tools)
            if cache.is_done(run, tools):
                continue
            log = run.log
            base = getattr(log, "base", log)
            if hasattr(base, "world"):
                tools.check_world(base.world, base.options)
        except NotBuilt as problem:
            impossible[run] = str(problem)
            continue
        log_key = log.key(tools)
        jobs.setdefault(log_key, Job(log, log_key, {})).runs.setdefault(key, (name, run))
    return list(jobs.values()), impossible


class Progress:
    """Lines on stderr: what is done, how long the rest will take."""

    def __init__(self, cache, jobs, threads):
        self.cache, self.threads = cache, threads
        self.lock = threading.Lock()
        self.left = {key: self.guess(name, run) for job in jobs for key, (name, run) in job.runs.items()}
        self.total, self.begun = len(self.left), time.monotonic()

    def guess(self, name, run):
        return self.cache.times().get(name, 1.3 * run.cost)

    def say(self, words):
        left_s = sum(self.left.values()) / self.threads
        left = f"about {int(left_s) // 60}:{int(left_s) % 60:02} min left"
        print(f"[{self.total - len(self.left)}/{self.total}] {words}; {left}", file=sys.stderr, flush=True)

    def done(self, key, name, seconds, words):
        with self.lock:
            if seconds is not None:
                self.cache.note_time(name, seconds)
            self.left.pop(key, None)
            self.say(f"{name}: {words}")


def execute(jobs, cache, tools, threads, keep_logs):
    """Runs all jobs; returns {run key: words} of those that failed."""
    failures = {}
    progress = Progress(cache, jobs, threads)
    if jobs:
        progress.say("begins")

    def execute_one(job):
        try:
            cache.make_log(job.log, tools)
        except (Failed, NotBuilt, ValueError) as problem:
            for key, (name, _) in job.runs.items():
                failures[key] = f"no log: {problem}"
                progress.done(key, name, None, failures[key])
            return
        for key, (name, run) in job.runs.items():
            begun = time.monotonic()
            try:
                cache.make_run(run, tools)
                cache.outcome(run, tools)
                words, seconds = f"{time.monotonic() - begun:.0f} s", time.monotonic() - begun
            except Failed as problem:
                failures[key] = words = str(problem)
                seconds = None
            progress.done(key, name, seconds, words)
        if not keep_logs:
            cache.drop_log(job.log_key)

    pool = concurrent.futures.ThreadPoolExecutor(threads)
    for done in concurrent.futures.as_completed([pool.submit(execute_one, job) for job in jobs]):
        done.result()
    return failures
