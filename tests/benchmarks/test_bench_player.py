"""An hour at 200 Hz played from anywhere: the first pass, seeks and memory.

pytest -m 'slow and benchmark' -s tests/benchmarks/test_bench_player.py
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [pytest.mark.benchmark, pytest.mark.slow]

MOST_GROWTH_MB = 30.0
PROGRAM = Path(__file__).with_name("bench_player.py")


@pytest.mark.timeout(1500)
def test_an_hour_is_known_soon_sought_at_once_and_takes_little_memory(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, PROGRAM, tmp_path / "hour.qrec", os.environ.get("PLAYER_HOURS", "1")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    print("\n" + done.stdout)
    grown_mb = float(done.stdout.rpartition("memory +")[2].split()[0])
    assert grown_mb < MOST_GROWTH_MB
