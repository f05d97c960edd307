"""The five papers' experiments by their number."""

from __future__ import annotations

from importlib import import_module

from quavelet.core.errors import SettingsError
from quavelet.study.experiment import Experiment

NUMBERS = ("000", "001", "002", "003", "004")


def experiment(number: str) -> Experiment:
    """The experiment of paper `number`. Raises SettingsError where there is none."""
    if number not in NUMBERS:
        raise SettingsError(f"there is no paper {number}: give {', '.join(NUMBERS)} or all")
    found = import_module(f"quavelet.study.paper{number}").EXPERIMENT
    assert isinstance(found, Experiment)
    return found
