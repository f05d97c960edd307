"""The unit under a real systemd, in namespaces of its own, on the fake chip.

Not proven here: LimitRTPRIO and LimitMEMLOCK (root of a container may not raise them) and DeviceAllow=char-i2c
(there is no I2C driver).
"""

import re
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

HERE = Path(__file__).parent
REPOSITORY = HERE.parents[1]
UNIT = REPOSITORY / "systemd" / "quavelet@.service"

PREPARE = """
groupadd --force --system i2c
useradd --system --user-group --groups i2c --no-create-home --shell /usr/sbin/nologin quavelet
mkdir /etc/quavelet
sed 's/^name = "linux:1"/name = "fake:tilt"/' /opt/quavelet/repository/systemd/quavelet.toml > /etc/quavelet/imu0.toml
# As the udev rule would leave it.
if [ -n "$DMA" ]; then (umask 117; mknod /dev/cpu_dma_latency c $DMA; chgrp i2c /dev/cpu_dma_latency); fi
edit() {
    mkdir -p /run/systemd/system/quavelet@imu0.service.d
    cat > /run/systemd/system/quavelet@imu0.service.d/edit.conf
    systemctl daemon-reload
}
property() { systemctl show --value -p "$1" quavelet@imu0; }
# The condition, looked at for as long as ten seconds.
until_true() {
    for _ in $(seq 200); do if eval "$1"; then return; fi; sleep 0.05; done
    echo "never: $1"; told; exit 1
}
told() { journalctl --sync; journalctl -u quavelet@imu0 --no-pager -o cat; }
"""


def _in_systemd(tmp_path: Path, script: str) -> str:
    """What `script` prints; it must end well."""
    dma = Path("/dev/cpu_dma_latency")
    numbers = ""
    if dma.exists():
        device = dma.stat().st_rdev
        numbers = f"{device >> 8 & 0xFFF} {device & 0xFF | device >> 12 & 0xFFF00}"
    job = tmp_path / "job.sh"
    job.write_text(f'DMA="{numbers}"\n{PREPARE}\n{script}\n')
    done = subprocess.run(
        [
            "bash",
            HERE / "private_systemd.sh",
            job,
            UNIT,
            sys.base_prefix,
            sysconfig.get_path("purelib"),
            REPOSITORY,
        ],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.stdout.endswith("job ended with 0\n"), done.stdout + done.stderr
    return done.stdout.removesuffix("job ended with 0\n")


@pytest.fixture(scope="module", autouse=True)
def needs_systemd(tmp_path_factory: pytest.TempPathFactory) -> None:
    if not all(map(shutil.which, ("unshare", "useradd"))) or not Path("/lib/systemd/systemd").exists():
        pytest.skip("systemd, unshare or useradd is not installed")
    try:
        _in_systemd(tmp_path_factory.mktemp("probe"), "true")
    except AssertionError as error:
        pytest.skip(f"no private systemd can be booted here: {error}"[:300])


@pytest.mark.slow
def test_the_service_runs_in_its_sandbox_and_its_stop_is_a_success(tmp_path: Path) -> None:
    told = _in_systemd(
        tmp_path,
        """
        systemctl start quavelet@imu0
        until_true 'told | grep -q priority:'
        systemctl is-active quavelet@imu0
        systemctl stop quavelet@imu0
        echo "$(property ActiveState) $(property Result)"
        told
        """,
    )
    assert told.startswith("active\ninactive success\n"), told
    assert "samples from fake:tilt" in told
    assert '"v":1' not in told  # a hundred lines a second have no place in the journal
    if Path("/dev/cpu_dma_latency").exists():
        assert "cpu_dma_latency: done" in told


@pytest.mark.slow
def test_a_program_behind_a_pipe_gets_the_messages(tmp_path: Path) -> None:
    readme = (UNIT.parent / "README.md").read_text()
    (edit,) = re.findall(
        r"^    (\[Service\]\n    ExecStart=\n    ExecStart=.* \| /opt/mine/program'\n)", readme, re.MULTILINE
    )
    told = _in_systemd(
        tmp_path,
        f"""
        mkdir /opt/mine
        printf '#!/bin/sh\\nexec tee lines >&2\\n' > /opt/mine/program
        chmod 755 /opt/mine/program
        edit <<'P'
{edit}
P
        systemctl start quavelet@imu0
        until_true '[ -s /var/lib/quavelet/lines ]'
        systemctl stop quavelet@imu0
        property Result
        head -1 /var/lib/quavelet/lines
        """,
    )
    result, line = told.splitlines()
    assert result == "success"
    assert line.startswith('{"v":1,')


@pytest.mark.slow
def test_a_killed_service_comes_back(tmp_path: Path) -> None:
    told = _in_systemd(
        tmp_path,
        """
        edit <<< $'[Service]\\nRestartSec=100ms'
        systemctl start quavelet@imu0
        systemctl kill --signal=KILL quavelet@imu0
        until_true '[ "$(property NRestarts)" -ge 1 ] && [ "$(property ActiveState)" = active ]'
        echo back
        """,
    )
    assert told == "back\n"


@pytest.mark.slow
def test_a_chip_that_is_not_there_is_tried_for_again_and_again(tmp_path: Path) -> None:
    told = _in_systemd(
        tmp_path,
        """
        sed -i 's/^address = .*/address = 0x69/' /etc/quavelet/imu0.toml
        edit <<< $'[Service]\\nRestartSec=10ms'
        systemctl start quavelet@imu0
        # Systemd's usual limit is five starts in ten seconds.
        until_true '[ "$(property NRestarts)" -ge 6 ]'
        # It is 0 as long as the next try runs.
        until_true '[ "$(property ExecMainStatus)" = 4 ]'
        told
        """,
    )
    assert "quavelet: no answer from address 0x69 on fake:tilt" in told


@pytest.mark.slow
def test_a_setting_that_cannot_be_is_told_once_and_not_tried_again(tmp_path: Path) -> None:
    told = _in_systemd(
        tmp_path,
        """
        sed -i 's/^sample_rate_hz = .*/sample_rate_hz = 300/' /etc/quavelet/imu0.toml
        edit <<< $'[Service]\\nRestartSec=10ms'
        systemctl start quavelet@imu0
        until_true '[ "$(property ActiveState)" = failed ]'
        echo "$(property ExecMainStatus) $(property NRestarts)"
        told
        """,
    )
    assert told.startswith("3 0\n"), told
    assert "/etc/quavelet/imu0.toml: chip: sample_rate_hz = 300 cannot be made" in told


@pytest.mark.slow
def test_a_program_in_the_sandbox_reaches_nothing_but_its_own_folder(tmp_path: Path) -> None:
    told = _in_systemd(
        tmp_path,
        """
        cat > /run/probe.py <<'P'
import errno, os, socket
def attempt(name, what):
    try:
        what()
        print("PROBE", name, "allowed")
    except OSError as error:
        print("PROBE", name, errno.errorcode[error.errno])
for path in ("/etc/x", "/usr/x", "/opt/quavelet/x", "/run/x", "/var/x", "x"):
    attempt(path, lambda: open(path, "w"))
attempt("home", lambda: os.listdir("/root"))
attempt("kmsg", lambda: open("/dev/kmsg", "rb"))
attempt("i2c", lambda: open("/dev/i2c-1", "rb"))
attempt("inet", lambda: socket.socket(socket.AF_INET))
attempt("unix", lambda: socket.socket(socket.AF_UNIX))
attempt("setuid", lambda: os.setuid(0))
P
        mknod -m 666 /dev/kmsg c 1 11; mknod -m 666 /dev/i2c-1 c 89 1
        edit <<'P'
[Service]
ExecStart=
ExecStart=/opt/quavelet/venv/bin/python /run/probe.py
StandardOutput=journal
P
        systemctl start quavelet@imu0
        until_true '[ "$(property ActiveState)" = inactive ]'
        told
        """,
    )
    allowed = [line.split()[1] for line in told.splitlines() if line.startswith("PROBE") and line.endswith("allowed")]
    assert told.count("PROBE") == 12, told
    # Without a driver, an I2C bus that may be opened is ENXIO.
    assert "PROBE i2c EPERM" in told
    assert "PROBE /usr/x EROFS" in told  # not for being of another user only
    assert allowed == ["x", "unix"]
