"""The two files of others that the page uses: as they were made, by whom, and that they can be made again."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
VENDOR = ROOT / "src" / "quavelet" / "web" / "page" / "vendor"
SERVED = {"three.LICENSE.txt", "three.min.js", "uplot.LICENSE.txt", "uplot.css", "uplot.min.js"}
BUILT_FROM = {"build.mjs", "package.json", "package-lock.json", "three_used.js"}


def sums(folder: Path) -> dict[str, str]:
    lines = (folder / "SHA256SUMS").read_text(encoding="utf-8").splitlines()
    return {name: digest for digest, name in (line.split("  ") for line in lines)}


def test_a_vendored_file_is_changed_by_hand():
    assert sums(VENDOR) == {name: sha256((VENDOR / name).read_bytes()).hexdigest() for name in SERVED}


def test_a_file_of_others_lies_there_without_a_hash():
    assert {path.name for path in VENDOR.iterdir() if path.is_file()} == (
        SERVED | BUILT_FROM | {"SHA256SUMS", ".gitignore"}
    )


def test_what_is_downloaded_to_build_is_pinned_by_version_and_hash():
    wanted = json.loads((VENDOR / "package.json").read_text())["devDependencies"]
    assert all(re.fullmatch(r"\d+\.\d+\.\d+", version) for version in wanted.values())
    packages = json.loads((VENDOR / "package-lock.json").read_text())["packages"]
    own = packages.pop("")
    assert own["devDependencies"] == wanted
    assert {name: packages[f"node_modules/{name}"]["version"] for name in wanted} == wanted
    for name, package in packages.items():
        assert package["integrity"].startswith("sha512-"), name
        assert package.get("resolved", "https://registry.npmjs.org/").startswith("https://registry.npmjs.org/"), name


def test_each_comes_with_its_licence():
    for name, holder in (("three", "three.js authors"), ("uplot", "Leon Sorokin")):
        text = (VENDOR / f"{name}.LICENSE.txt").read_text(encoding="utf-8")
        assert "MIT" in text and "Permission is hereby granted, free of charge" in text and holder in text
    assert "SPDX-License-Identifier: MIT" in (VENDOR / "three.min.js").read_text(encoding="utf-8")


def test_the_page_loads_more_of_three_than_it_uses():
    used = re.search(r"import \{(.*?)\} from \"./vendor/three.min.js\"", (VENDOR.parent / "board.js").read_text(), re.S)
    given = re.search(r"export \{(.*?)\} from \"three\"", (VENDOR / "three_used.js").read_text(), re.S)
    assert used and given
    assert {n.strip() for n in used[1].split(",")} - {""} == {n.strip() for n in given[1].split(",")} - {""}
    assert (VENDOR / "three.min.js").stat().st_size < 600_000


def test_nothing_but_what_is_served_is_in_the_wheel(tmp_path: Path):
    pytest.importorskip("setuptools")
    command = ["-q", "egg_info", "--egg-base", str(tmp_path), "build_py", "--build-lib", str(tmp_path / "wheel")]
    build = [sys.executable, "-W", "ignore", "-c", "from setuptools import setup; setup()", *command]
    done = subprocess.run(build, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    packed = tmp_path / "wheel" / "quavelet" / "web" / "page"
    names = {path.relative_to(packed).as_posix() for path in packed.rglob("*") if path.is_file()}
    own = {path.name for path in VENDOR.parent.iterdir() if path.is_file()}
    assert names >= own | {f"vendor/{name}" for name in SERVED}
    assert not [name for name in names if "node_modules" in name]


@pytest.mark.slow
def test_npm_makes_the_same_files_to_the_byte(tmp_path: Path):
    npm = shutil.which("npm")
    if npm is None:
        pytest.skip("npm is not here")
    for name in BUILT_FROM:
        shutil.copy(VENDOR / name, tmp_path)
    for command in (["ci", "--no-audit", "--no-fund"], ["run", "build"]):
        done = subprocess.run([npm, *command], cwd=tmp_path, capture_output=True, text=True, check=False)
        if command[0] == "ci" and re.search(r"ENOTFOUND|EAI_AGAIN|ECONNREFUSED|ETIMEDOUT|ENETUNREACH", done.stderr):
            pytest.skip("no way to npm's registry from here")
        assert done.returncode == 0, done.stderr
    assert sums(tmp_path) == sums(VENDOR)
