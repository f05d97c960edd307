"""What systemd makes of what the service tells it: ready, frozen, missing, reloaded."""

import re
from pathlib import Path

import pytest
from in_systemd import in_systemd

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("needs_systemd")]


def test_it_is_ready_with_the_first_attitude_that_is_to_be_trusted_and_not_before(tmp_path: Path) -> None:
    told = in_systemd(
        tmp_path,
        """
        use_bus told:still
        echo 'frozen for=4' > /run/faults
        systemctl start --no-block quavelet@imu0
        until_true 'property StatusText | grep -q "lost: the chip is stuck"'
        property ActiveState
        until_true '[ "$(property ActiveState)" = active ]'
        property StatusText
        """,
    )
    before, after = told.splitlines()
    assert before == "activating"
    assert after.startswith("running; roll ")


def test_a_chip_that_freezes_is_restarted_by_the_watchdog_and_what_it_did_is_told(tmp_path: Path) -> None:
    told = in_systemd(
        tmp_path,
        """
        use_bus told:still
        edit <<< $'[Service]\\nWatchdogSec=3\\nRestartSec=100ms'
        systemctl start quavelet@imu0
        sleep 4
        echo "restarts while samples come: $(property NRestarts)"
        echo frozen > /run/faults
        until_true '[ "$(property NRestarts)" -ge 1 ]'
        rm /run/faults
        until_true '[ "$(property ActiveState)" = active ]'
        told
        """,
    )
    assert told.startswith("restarts while samples come: 0\n"), told
    assert "Fatal Python error: Aborted" in told and "Current thread" in told  # and where it was


def test_a_program_that_hangs_is_restarted_by_the_watchdog(tmp_path: Path) -> None:
    told = in_systemd(
        tmp_path,
        """
        edit <<< $'[Service]\\nWatchdogSec=1\\nRestartSec=100ms\\nTimeoutAbortSec=1'
        systemctl start quavelet@imu0
        kill -STOP "$(property MainPID)"
        until_true '[ "$(property NRestarts)" -ge 1 ] && [ "$(property ActiveState)" = active ]'
        echo back
        """,
    )
    assert told == "back\n"


def test_a_chip_that_is_frozen_from_the_start_is_given_up_and_tried_anew(tmp_path: Path) -> None:
    told = in_systemd(
        tmp_path,
        """
        use_bus told:still
        echo frozen > /run/faults
        edit <<< $'[Service]\\nTimeoutStartSec=5\\nRestartSec=100ms'
        systemctl start --no-block quavelet@imu0
        until_true '[ "$(property NRestarts)" -ge 1 ]'
        property ActiveEnterTimestampMonotonic
        told
        """,
    )
    assert told.startswith("0\n"), told  # it never was ready
    assert "no axis has changed" in told


def test_a_chip_that_is_missing_at_boot_holds_up_nothing_and_is_found_when_it_comes(tmp_path: Path) -> None:
    told = in_systemd(
        tmp_path,
        """
        use_bus told:still
        touch /run/absent
        edit <<< $'[Service]\\nTimeoutStartSec=6'
        printf '[Unit]\\nWants=quavelet@imu0.service\\n' > /run/systemd/system/boot.target
        systemctl daemon-reload
        systemctl start boot.target
        systemctl is-active boot.target
        until_true 'property StatusText | grep -q "waiting for the chip"'
        property StatusText
        sleep 13
        echo "$(property ActiveState) $(property NRestarts)"
        rm /run/absent
        until_true '[ "$(property ActiveState)" = active ]'
        property NRestarts
        told
        """,
    )
    lines = told.splitlines()
    assert lines[0] == "active", told
    assert lines[1].startswith("waiting for the chip; no answer from address 0x68")
    assert lines[2:4] == ["activating 0", "0"]  # twice the time to start has gone by
    assert sum("no answer from address 0x68" in line for line in lines[4:]) == 1


def test_a_chip_that_is_unplugged_for_long_ends_the_program_and_is_waited_for(tmp_path: Path) -> None:
    told = in_systemd(
        tmp_path,
        """
        use_bus told:still
        edit <<< $'[Service]\\nRestartSec=100ms'
        systemctl start quavelet@imu0
        touch /run/absent
        echo unplugged > /run/faults
        until_true '[ "$(property NRestarts)" = 1 ] && property StatusText | grep -q "waiting for the chip"'
        rm /run/absent /run/faults
        until_true '[ "$(property ActiveState)" = active ]'
        property NRestarts
        told
        """,
    )
    assert told.startswith("1\n"), told
    assert "has given nothing for 10 s" in told


def test_a_stop_is_heeded_while_the_chip_is_missing(tmp_path: Path) -> None:
    told = in_systemd(
        tmp_path,
        """
        use_bus told:still
        touch /run/absent
        systemctl start --no-block quavelet@imu0
        until_true 'property StatusText | grep -q "waiting for the chip"'
        systemctl stop quavelet@imu0
        echo "$(property ActiveState) $(property Result)"
        """,
    )
    assert told == "inactive success\n"


def test_a_reload_takes_good_settings_refuses_broken_ones_and_keeps_the_process(tmp_path: Path) -> None:
    told = in_systemd(
        tmp_path,
        """
        systemctl start quavelet@imu0
        pid=$(property MainPID)
        sed -i 's/^dlpf = .*/dlpf = 99/' /etc/quavelet/imu0.toml
        systemctl reload quavelet@imu0
        until_true 'property StatusText | grep -q "the old ones stay in force"'
        property StatusText
        sed -i 's/^dlpf = .*/dlpf = 4/' /etc/quavelet/imu0.toml
        systemctl reload quavelet@imu0
        until_true 'property StatusText | grep -q "only after a restart: chip.dlpf"'
        echo "$(property ActiveState) $(property NRestarts) $([ "$pid" = "$(property MainPID)" ] && echo same)"
        told
        """,
    )
    first, second, *rest = told.splitlines()
    assert "refused" in first and "/etc/quavelet/imu0.toml: chip" in first
    assert second == "active 0 same"
    assert any("the settings were read again; only after a restart: chip.dlpf" in line for line in rest)


def test_a_killed_service_goes_on_with_its_yaw(tmp_path: Path) -> None:
    told = in_systemd(
        tmp_path,
        """
        use_bus told:turned
        edit <<< $'[Service]\\nRestartSec=500ms'
        systemctl start quavelet@imu0
        # Turned, and still for as long as it takes to say so.
        sleep 20
        ls /run/quavelet/imu0.state
        systemctl kill --kill-whom=main --signal=KILL quavelet@imu0
        until_true '[ "$(property NRestarts)" = 1 ] && [ "$(property ActiveState)" = active ]'
        property StatusText
        told
        """,
    )
    file, status, *rest = told.splitlines()
    assert file == "/run/quavelet/imu0.state"
    assert re.match(r"running; .* yaw (39|40)\.\d deg \(relative\)", status), told
    assert any("the attitude goes on from where it was" in line for line in rest)


def test_an_output_on_the_network_needs_the_drop_in_and_no_more(tmp_path: Path) -> None:
    told = in_systemd(
        tmp_path,
        """
        ip link set lo up
        printf '[output.phone]\\nto = "udp:127.0.0.1:5555"\\nrate_hz = 20.0\\n' >> /etc/quavelet/imu0.toml
        cat > /run/heard.py <<'P'
import socket
heard = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
heard.bind(("127.0.0.1", 5555))
heard.settimeout(4)
try:
    print(heard.recv(4096)[:7].decode())
except TimeoutError:
    print("nothing")
P
        systemctl start quavelet@imu0
        /opt/quavelet/venv/bin/python /run/heard.py
        systemctl stop quavelet@imu0
        install -D -m 644 /opt/quavelet/repository/systemd/network.conf -t /etc/systemd/system/quavelet@imu0.service.d/
        systemctl daemon-reload
        systemctl start quavelet@imu0
        /opt/quavelet/venv/bin/python /run/heard.py
        property ActiveState
        """,
    )
    assert told.splitlines() == ["nothing", '{"v":1,', "active"]


def test_an_output_comes_and_goes_with_a_reload_and_the_process_stays(tmp_path: Path) -> None:
    told = in_systemd(
        tmp_path,
        """
        systemctl start quavelet@imu0
        pid=$(property MainPID)
        cp /etc/quavelet/imu0.toml /run/before.toml
        printf '[output.mine]\\nto = "unix:/run/quavelet/mine.sock"\\n' >> /etc/quavelet/imu0.toml
        systemctl reload quavelet@imu0
        until_true '[ -S /run/quavelet/mine.sock ]'
        cp /run/before.toml /etc/quavelet/imu0.toml
        systemctl reload quavelet@imu0
        until_true '[ ! -e /run/quavelet/mine.sock ]'
        echo "$(property ActiveState) $(property NRestarts) $([ "$pid" = "$(property MainPID)" ] && echo same)"
        """,
    )
    assert told == "active 0 same\n"
