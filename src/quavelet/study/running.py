"""Experiments in processes of their own, as many at a time as there are processors.

Each draws from generators of its own and computes on one thread, so the rows are the same however many run beside it.
"""

from __future__ import annotations

import os
import signal
import traceback
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any

from quavelet.core.errors import ImuError
from quavelet.study.experiment import Effort, Experiment, Result

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""What the libraries below numpy go by; sums in several threads could round differently."""


class ExperimentLost(ImuError):
    """An experiment's process ended without a result."""


@dataclass(frozen=True, slots=True)
class Step:
    """An experiment has come so far: the share done, and what it is at."""

    paper: str
    share: float
    what: str


@dataclass(frozen=True, slots=True)
class Failure:
    """What an experiment died of, as text."""

    trace: str


def run_all(
    experiments: Sequence[Experiment], effort: Effort, *, tell: Callable[[Step], None], at_once: int | None = None
) -> Generator[tuple[Experiment, Result], None, None]:
    """Each experiment with its result, in their order and each as soon as it and those before it are there.

    `at_once` is how many run beside each other, without it one a processor. Left early, by an exception or by Ctrl-C,
    it ends those that still run. Raises ExperimentLost where a process was killed, RuntimeError with the trace where
    an experiment is broken.
    """
    waiting = list(enumerate(experiments))
    running: dict[Connection, tuple[int, BaseProcess]] = {}
    results: dict[int, Result] = {}
    given = 0
    try:
        while given < len(experiments):
            while waiting and len(running) < (at_once or len(os.sched_getaffinity(0))):
                place, experiment = waiting.pop(0)
                connection, process = _started(experiment, effort)
                running[connection] = place, process
            ready = wait(list(running))
            for connection in [one for one in running if one in ready]:
                place, process = running[connection]
                message = _received(connection)
                if isinstance(message, Step):
                    tell(message)
                    continue
                process.join()
                connection.close()
                del running[connection]
                results[place] = _result(message, experiments[place], process.exitcode)
            while given in results:
                yield experiments[given], results.pop(given)
                given += 1
    finally:
        for _, process in running.values():
            process.terminate()
        for connection, (_, process) in running.items():
            process.join()
            connection.close()


def _started(experiment: Experiment, effort: Effort) -> tuple[Connection, BaseProcess]:
    context = get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(experiment, effort, theirs), daemon=True)
    with _environment(ONE_THREAD), _without_interrupts():
        process.start()
    theirs.close()
    return ours, process


def _work(experiment: Experiment, effort: Effort, connection: Connection) -> None:
    """In the new process."""
    try:
        result = experiment.run(effort, lambda share, what: connection.send(Step(experiment.paper, share, what)))
        connection.send(result)
    except BrokenPipeError:
        pass  # nobody waits for it any longer
    except Exception:  # noqa: BLE001 - whatever it is, the other process says it
        connection.send(Failure(traceback.format_exc()))


def _received(connection: Connection) -> Any:
    try:
        return connection.recv()
    except EOFError:
        return None


def _result(message: object, experiment: Experiment, exit_code: int | None) -> Result:
    if isinstance(message, Result):
        return message
    if isinstance(message, Failure):
        raise RuntimeError(f"the experiment of paper {experiment.paper} is broken\n{message.trace}")
    raise ExperimentLost(
        f"the experiment of paper {experiment.paper} was ended from outside (exit code {exit_code}), for want of "
        f"memory perhaps: run it by itself, quavelet reproduce {experiment.paper}"
    )


@contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """A process that begins in here never gets Ctrl-C: the one that began it ends it."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
