"""Experiments beside each other: in order, the same each time, and none left behind."""

from __future__ import annotations

import os
import signal
import time

import fake_experiments as fake
import pytest

from quavelet.study.experiment import Effort, Result, silent
from quavelet.study.running import ExperimentLost, Step, run_all


def ignore(_step: Step) -> None:
    """Tell nobody."""


def shown(result: Result) -> str:
    """The rows to the last digit; as numbers, one NaN is not another."""
    return repr(result.rows)


def running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


def test_results_come_in_the_order_asked_for_and_are_those_of_this_process():
    slow, quick = fake.named("000", fake.slow_then_well), fake.named("001", fake.well)
    steps: list[Step] = []
    done = list(run_all([slow, quick], Effort.QUICK, tell=steps.append, at_once=2))
    assert [experiment.paper for experiment, _ in done] == ["000", "001"]
    assert [shown(result) for _, result in done] == [shown(fake.well(Effort.QUICK, silent))] * 2
    assert Step("001", 0.5, "halfway") in steps


def test_one_at_a_time_gives_what_all_at_once_give():
    experiments = [fake.WELL, fake.OUTSIDE]
    one = [shown(result) for _, result in run_all(experiments, Effort.FULL, tell=ignore, at_once=1)]
    two = [shown(result) for _, result in run_all(experiments, Effort.FULL, tell=ignore, at_once=2)]
    assert one == two


def test_a_broken_experiment_says_where():
    with pytest.raises(RuntimeError, match=r"paper 003 is broken[\s\S]*fake_experiments.py[\s\S]*the sum of nothing"):
        list(run_all([fake.named("003", fake.broken)], Effort.FULL, tell=ignore))


def test_a_killed_experiment_is_missed_and_not_waited_for():
    with pytest.raises(ExperimentLost, match=r"paper 003 was ended from outside .exit code -9.*reproduce 003"):
        list(run_all([fake.named("003", fake.killed)], Effort.FULL, tell=ignore))


def test_whoever_stops_listening_leaves_no_process_behind():
    seen: list[int] = []

    def stop(step: Step) -> None:
        seen.append(int(step.what.removeprefix("process ")))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        list(run_all([fake.named("000", fake.endless)], Effort.FULL, tell=stop))
    assert len(seen) == 1
    assert not running(seen[0])


def test_ctrl_c_is_not_heard_by_the_experiments():
    """The terminal sends it to all processes; the one that started them ends them, without their traces."""
    seen: list[int] = []

    def interrupt_it(step: Step) -> None:
        process = int(step.what.removeprefix("process "))
        os.kill(process, signal.SIGINT)
        time.sleep(0.2)
        assert running(process)
        seen.append(process)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        list(run_all([fake.named("000", fake.endless)], Effort.FULL, tell=interrupt_it))
    assert len(seen) == 1
