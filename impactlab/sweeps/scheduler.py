"""Several simulations at a time, on threads that they share."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from typing import Any

from impactlab.errors import KINDS, ImpactLabError, ImpactLabWarning, Interrupted, Listener, give, heard_by
from impactlab.machine import SharedThreads, begin, cores, hand_over, workers_of

Job = Callable[[Executor, Callable[[float], None]], Any]
"""Simulates something on an executor, calls back with the part that is done, and returns its outcome."""


MOST_SAID = 3
"""Warnings that a set of jobs gives at most."""


class Heard:
    """Warnings by category and kind, and by the keys of the jobs that gave them."""

    def __init__(self) -> None:
        self.given: dict[tuple[type[ImpactLabWarning], str], dict[str, ImpactLabWarning]] = {}

    def of(self, key: str) -> Listener:
        """Return a listener for the warnings of a job; the first warning of each kind counts."""

        def hear(warning: ImpactLabWarning) -> None:
            self.given.setdefault((type(warning), warning.kind), {}).setdefault(key, warning)

        return hear

    def of_job(self, key: str) -> list[ImpactLabWarning]:
        """Return the warnings of a job."""
        return [warnings[key] for warnings in self.given.values() if key in warnings]

    def say(self, what: str, order: Iterable[str]) -> None:
        """Give one warning of each kind, that of the first job that it concerns, and the number of jobs.

        Where there are more than `MOST_SAID` kinds, the last warning lists those that concern the fewest jobs.
        """
        order = list(order)
        rank = {kind: place for place, kind in enumerate(KINDS)}  # whatever the order in which they were given
        kinds = sorted(self.given.items(), key=lambda item: (-len(item[1]), rank[item[0][1]]))
        said = kinds if len(kinds) <= MOST_SAID else kinds[: MOST_SAID - 1]
        for (category, kind), warnings in said:
            first = next(key for key in order if key in warnings)
            number = f"In {len(warnings)} of {len(order)} {what.lower()}s, first"
            give(category(f"{number if len(warnings) > 1 else what} {first!r}: {warnings[first]}", kind))
        if rest := kinds[len(said) :]:
            causes = "; ".join(f"{KINDS[kind]} (in {len(warnings)})" for (_, kind), warnings in rest)
            (category, kind), _ = rest[0]
            text = f"Also in some of {len(order)} {what.lower()}s: {causes}. See `warnings` in the result."
            give(category(text, kind))


def run_in_turn(jobs: Mapping[str, Callable[[], Any]], heard: Heard) -> dict[str, Any]:
    """Run short jobs one after the other, in this thread; return the outcome of each, or the error raised on purpose.

    Threads would take turns with them, since they are Python, and handing over costs more than many a job.
    """
    outcomes: dict[str, Any] = {}
    for key, job in jobs.items():
        try:
            with heard_by(heard.of(key)):
                outcomes[key] = job()
        except ImpactLabError as error:
            outcomes[key] = error
    return outcomes


def run_together(
    jobs: Mapping[str, Job],
    finished: Callable[[str, Any], None],
    *,
    kind: str,
    executor: Executor | None = None,
    workers: int | None = None,
    alone: bool = False,
    watch: Callable[[str, Mapping[str, float]], None] = lambda key, parts: None,
    heard: Heard | None = None,
) -> None:
    """Run jobs side by side, so that what one does on a single core fills the gaps of the others.

    When a function that is called here raises an error, or Ctrl-C is pressed, all jobs stop. `finished` is called in
    the order of the jobs with the key of each and its outcome, or the error that it raised on purpose; `watch` now and
    then with the key of the job that is waited for and the parts that are done. `kind` is what a job is called in
    warnings, which are given once, however many jobs they concern, unless somebody else has `heard` them. Blocks run on
    the executor, or on as many threads as `workers`, by default one per core. Jobs that measure their time run `alone`:
    each has the cores for itself.
    """
    threads = cores() if workers is None else workers
    parts = dict.fromkeys(jobs, 0.0)
    hearing = heard or Heard()
    stop, waiting = threading.Event(), deque(jobs)
    at_once = 1 if alone else min(len(jobs), threads if executor is None else max(16, 2 * workers_of(executor))) or 1
    pool = executor or SharedThreads(threads, at_once)
    turns = ThreadPoolExecutor(at_once)
    patient = True

    def outcome(key: str) -> Any:
        def note(part: float) -> None:
            if stop.is_set():
                raise Interrupted(f"{kind} {key!r} was stopped.")
            parts[key] = max(parts[key], part)

        note(0.0)
        try:
            with heard_by(hearing.of(key)):
                return jobs[key](pool, note)
        except BaseException as error:  # raised in its turn, unless on purpose: jobs before it are finished
            return error
        finally:
            parts[key] = 1.0

    def show() -> None:
        if waiting:
            watch(waiting[0], parts)

    def take(result: Any) -> None:
        if isinstance(result, BaseException) and not isinstance(result, ImpactLabError):
            raise result
        show()
        finished(waiting[0], result)
        watch(waiting.popleft(), parts)

    try:
        if executor is not None and jobs:
            begin(executor)  # processes are forked here, not by a thread while another one computes
        hand_over((turns.submit(outcome, key) for key in jobs), take, show, stop, 4 * at_once)
    except KeyboardInterrupt:
        patient = False  # a thread that compiles would have to be waited for
        raise
    finally:
        turns.shutdown(wait=patient, cancel_futures=True)
        if executor is None:
            pool.shutdown(wait=patient, cancel_futures=True)
    if heard is None:
        hearing.say(kind, jobs)


def run_points(
    jobs: Mapping[str, Job],
    executor: Executor | None,
    show: Callable[[float], None],
    alone: bool = False,
    done: int = 0,
    heard: Heard | None = None,
) -> dict[str, Any]:
    """Run the jobs of a sweep, except points that are already `done`, and return the outcome of each point."""
    outcomes: dict[str, Any] = {}

    def watch(_: str, parts: Mapping[str, float]) -> None:
        part = (done + sum(parts.values())) / (done + len(parts))
        if part < 1.0 or len(outcomes) == len(jobs):  # the end is shown once
            show(part)

    run_together(jobs, outcomes.__setitem__, kind="Point", executor=executor, alone=alone, watch=watch, heard=heard)
    if done and not jobs:
        show(1.0)
    return outcomes
