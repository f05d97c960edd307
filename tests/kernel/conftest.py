"""The guest of these tests, booted once; skips where something for it is not installed."""

from __future__ import annotations

import pytest
from boot import Guest, boot
from debian_kernel import Missing, debian_kernel
from report import table


@pytest.fixture(scope="session")
def guest(tmp_path_factory: pytest.TempPathFactory) -> Guest:
    try:
        kernel = debian_kernel()
    except Missing as error:
        pytest.skip(str(error))
    guest = boot(kernel, tmp_path_factory.mktemp("guest"))
    print(table(kernel.release, guest.ended.seconds, guest.jobs))
    return guest
