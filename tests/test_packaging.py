"""What the wheel holds: a package forgotten in pyproject.toml is missed only by those who install it."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from importlib.metadata import entry_points
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def packages_below(folder: Path, name: str) -> set[str]:
    return {
        ".".join((name, *init.parent.relative_to(folder).parts)) for init in folder.rglob("__init__.py")
    }  # fmt: skip


def test_every_package_of_the_tree_is_in_the_wheel():
    found = packages_below(ROOT / "src" / "quavelet", "quavelet") | packages_below(ROOT / "hw_fakes", "hw_fakes")
    data = {"quavelet.service.systemd", "quavelet.web.page", "quavelet.web.page.vendor"}
    assert set(PROJECT["tool"]["setuptools"]["packages"]) == found | data


def test_both_packages_tell_type_checkers_that_they_are_typed():
    assert set(PROJECT["tool"]["setuptools"]["package-data"]) >= {"quavelet", "hw_fakes"}
    assert (ROOT / "src" / "quavelet" / "py.typed").exists()
    assert (ROOT / "hw_fakes" / "py.typed").exists()


def test_the_wheel_has_the_unit_and_the_rule(tmp_path: Path):
    pytest.importorskip("setuptools")
    command = ["-q", "egg_info", "--egg-base", tmp_path, "build_py", "--build-lib", tmp_path / "wheel"]
    build = [sys.executable, "-W", "ignore", "-c", "from setuptools import setup; setup()", *command]
    done = subprocess.run(build, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for name in ("quavelet@.service", "60-quavelet.rules", "network.conf", "gpio.conf"):
        packed = tmp_path / "wheel" / "quavelet" / "service" / "systemd" / name
        assert packed.read_text() == (ROOT / "systemd" / name).read_text()


def test_the_installed_buses_are_those_of_the_project():
    installed = {point.name: point.value for point in entry_points(group="quavelet.buses")}
    declared = PROJECT["project"]["entry-points"]["quavelet.buses"]
    assert {name: installed.get(name) for name in declared} == declared


def test_every_room_stands_in_the_linters_floors():
    contracts = PROJECT["tool"]["importlinter"]["contracts"]
    (floors,) = [c for c in contracts if c["type"] == "layers" and c["containers"] == ["quavelet"]]
    named = {name.strip() for layer in floors["layers"] for name in layer.split("|")}
    rooms = {path.stem for path in (ROOT / "src" / "quavelet").iterdir() if path.suffix == ".py" or path.is_dir()}
    assert named == rooms - {"__init__", "__pycache__"}
