"""Small experiments in place of the papers', which another process can run: it imports this module by its name."""

from __future__ import annotations

import os
import signal
import time

import numpy as np

from quavelet.drawing.chart import Chart, Curve
from quavelet.study.experiment import Effort, Experiment, Progress, Result, Row, Verdict

CHART = Chart(
    "000-walk",
    "A walk & <its> error",
    "time, s",
    "error, deg",
    (
        Curve("method 1", np.arange(4000.0), np.sin(np.arange(4000.0))),
        Curve("truth", np.arange(2.0), np.zeros(2), dashed=True),
    ),
    note="Nothing is to be seen.",
)
TABLE_ROW = Row(
    "T1.1",
    "method 1, largest error, pitch",
    printed=".0412",
    got=0.601,
    unit="deg",
    verdict=Verdict.REFUTED,
    note="An accelerometer has more noise.",
    reading="none",
)
GOOD = Row("0a", "noise of method 1", got=0.16, low=0.146, high=0.178, unit="deg")
NONE = Row("0n", "heading of method 1", got=float("nan"), unit="deg")
BAD = Row("0b", "noise of method 3", got=0.02, low=0.010, high=0.014, unit="deg", note="It should be less.")


def well(effort: Effort, progress: Progress) -> Result:
    progress(0.5, "halfway")
    rng = np.random.default_rng(1)
    row = Row("1a", f"mean of the {effort.value} run", got=float(rng.normal(size=(200, 200)).mean()), unit="", high=1.0)
    return Result((TABLE_ROW, GOOD, NONE, row), (CHART,), ("Eq. 4 lacks a factor 2.",))


def outside(_effort: Effort, _progress: Progress) -> Result:
    return Result((GOOD, BAD))


def slow_then_well(effort: Effort, progress: Progress) -> Result:
    time.sleep(0.5)
    return well(effort, progress)


def broken(_effort: Effort, _progress: Progress) -> Result:
    raise ZeroDivisionError("the sum of nothing")


def killed(_effort: Effort, _progress: Progress) -> Result:
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError


def endless(_effort: Effort, progress: Progress) -> Result:
    progress(0.0, f"process {os.getpid()}")
    time.sleep(600.0)
    raise AssertionError


def named(number: str, run) -> Experiment:
    return Experiment(number, f"fake {number}", "It claims much.", run)


WELL, OUTSIDE = named("000", well), named("001", outside)
