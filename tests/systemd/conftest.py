"""What the tests under a real systemd need."""

import shutil
from pathlib import Path

import pytest
from in_systemd import in_systemd


@pytest.fixture(scope="session")
def needs_systemd(tmp_path_factory: pytest.TempPathFactory) -> None:
    if not all(map(shutil.which, ("unshare", "useradd"))) or not Path("/lib/systemd/systemd").exists():
        pytest.skip("systemd, unshare or useradd is not installed")
    try:
        in_systemd(tmp_path_factory.mktemp("probe"), "true")
    except AssertionError as error:
        pytest.skip(f"no private systemd can be booted here: {error}"[:300])
