"""No counter is kept to itself."""

from __future__ import annotations

import ast
import inspect
import json
from itertools import pairwise

import pytest

from quavelet.core import health as module
from quavelet.core.health import Health

COUNTERS = {
    "samples", "samples_lost", "gaps", "drains", "fifo_empty", "fifo_overflows", "fifo_near_full", "fifo_misaligned",
    "fifo_resets", "bus_errors", "chip_restarts", "config_mismatches", "slow_queries", "rate_out_of_bounds",
    "records_damaged",
}  # fmt: skip


def test_all_counters_are_shown_and_begin_at_zero():
    shown = Health().as_dict()
    assert set(Health.__slots__) == set(shown)
    assert set(shown) >= COUNTERS
    assert set(shown.values()) == {0}


def test_each_counter_shows_its_own_value():
    health = Health()
    for k, name in enumerate(Health.__slots__, start=1):
        setattr(health, name, k)
    assert health.as_dict() == {name: k for k, name in enumerate(Health.__slots__, start=1)}
    assert json.loads(json.dumps(health.as_dict())) == health.as_dict()


def test_what_is_shown_does_not_change_afterwards():
    health = Health()
    shown = health.as_dict()
    health.gaps += 1
    assert (shown["gaps"], health.as_dict()["gaps"]) == (0, 1)
    shown["gaps"] = 9
    assert health.gaps == 1


def test_a_mistyped_counter_is_an_error_and_not_a_new_counter():
    with pytest.raises(AttributeError):
        Health().fifo_overflow = 1


def test_every_counter_says_what_it_counts():
    (body,) = [node.body for node in ast.parse(inspect.getsource(module)).body if isinstance(node, ast.ClassDef)]
    undocumented = [
        node.target.id
        for node, after in pairwise(body)
        if isinstance(node, ast.AnnAssign) and not isinstance(after, ast.Expr)
    ]
    assert undocumented == []
