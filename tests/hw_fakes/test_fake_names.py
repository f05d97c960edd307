"""What is had from hw_fakes itself, and what that costs."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

import hw_fakes

TREE = ast.parse(Path(hw_fakes.__file__).read_text(encoding="utf-8"))


def names_for_type_checkers() -> set[str]:
    (block,) = [node for node in TREE.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"]
    return {
        f"{line.module}.{alias.asname}"
        for line in block.body
        for alias in line.names
        if isinstance(line, ast.ImportFrom)
    }


def test_a_type_checker_sees_other_names_than_the_program():
    assert {f"hw_fakes.{hw_fakes._HOME[name]}.{name}" for name in hw_fakes.__all__} == names_for_type_checkers()


@pytest.mark.parametrize("name", hw_fakes.__all__)
def test_a_name_is_missing_or_another_thing_than_in_its_own_module(name: str):
    home = __import__(f"hw_fakes.{hw_fakes._HOME[name]}", fromlist=[name])
    assert getattr(hw_fakes, name) is getattr(home, name)
    assert name in dir(hw_fakes)


def test_a_name_that_is_none_is_no_attribute():
    with pytest.raises(AttributeError, match="'hw_fakes' has no attribute 'Mpu6050'"):
        _ = hw_fakes.Mpu6050
    with pytest.raises(ImportError, match="Mpu6050"):
        from hw_fakes import Mpu6050  # noqa: F401


@pytest.mark.parametrize("module", ["hw_fakes", "hw_fakes.pytest_plugin"])
def test_importing_it_loads_numpy_or_smbus2(module: str):
    """pytest loads the plugin in every session of everyone who has quavelet."""
    ask = f"import json, sys, {module}; print(json.dumps([name.partition('.')[0] for name in sys.modules]))"
    told = subprocess.run([sys.executable, "-c", ask], capture_output=True, text=True, check=True).stdout
    loaded = set(json.loads(told))
    assert "hw_fakes" in loaded
    assert not {"numpy", "smbus2", "quavelet"} & loaded
