"""The unit under a real systemd, in namespaces of its own, on the fake chip.

Not proven here: LimitRTPRIO and LimitMEMLOCK (root of a container may not raise them) and DeviceAllow=char-i2c
(there is no I2C driver).
"""

import re
from pathlib import Path

import pytest
from in_systemd import UNIT, in_systemd

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("needs_systemd")]
README = UNIT.parent / "README.md"


def test_the_service_runs_in_its_sandbox_and_its_stop_is_a_success(tmp_path: Path) -> None:
    told = in_systemd(
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


def test_a_program_behind_a_pipe_gets_the_messages(tmp_path: Path) -> None:
    readme = README.read_text()
    (edit,) = re.findall(
        r"^    (\[Service\]\n    ExecStart=\n    ExecStart=.* \| /opt/mine/program'\n(?:    .*\n)*)",
        readme,
        re.MULTILINE,
    )
    told = in_systemd(
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


def test_a_killed_service_comes_back(tmp_path: Path) -> None:
    told = in_systemd(
        tmp_path,
        """
        edit <<< $'[Service]\\nRestartSec=100ms'
        systemctl start quavelet@imu0
        systemctl kill --kill-whom=main --signal=KILL quavelet@imu0
        until_true '[ "$(property NRestarts)" -ge 1 ] && [ "$(property ActiveState)" = active ]'
        echo back
        """,
    )
    assert told == "back\n"


def test_another_chip_is_tried_for_again_and_again(tmp_path: Path) -> None:
    told = in_systemd(
        tmp_path,
        """
        use_bus told:still
        touch /run/stranger
        edit <<< $'[Service]\\nRestartSec=10ms'
        systemctl start --no-block quavelet@imu0
        # Systemd's usual limit is five starts in ten seconds.
        until_true '[ "$(property NRestarts)" -ge 6 ]'
        # It is 0 as long as the next try runs.
        until_true '[ "$(property ExecMainStatus)" = 4 ]'
        told
        """,
    )
    assert "WHO_AM_I" in told


def test_a_setting_that_cannot_be_is_told_once_and_not_tried_again(tmp_path: Path) -> None:
    told = in_systemd(
        tmp_path,
        """
        sed -i 's/^sample_rate_hz = .*/sample_rate_hz = 300/' /etc/quavelet/imu0.toml
        edit <<< $'[Service]\\nRestartSec=10ms'
        systemctl start --no-block quavelet@imu0
        until_true '[ "$(property ActiveState)" = failed ]'
        echo "$(property ExecMainStatus) $(property NRestarts)"
        told
        """,
    )
    assert told.startswith("3 0\n"), told
    assert "/etc/quavelet/imu0.toml: chip: sample_rate_hz = 300 cannot be made" in told


def test_a_program_in_the_sandbox_reaches_nothing_but_its_own_folder(tmp_path: Path) -> None:
    told = in_systemd(
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
Type=exec
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
