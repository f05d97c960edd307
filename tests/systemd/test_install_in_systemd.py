"""`quavelet service install` and `remove` on a real systemd: what was nothing runs, and is nothing again."""

from pathlib import Path

import pytest
from in_systemd import in_systemd

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("needs_systemd")]

FRESH = """
quavelet=/opt/quavelet/venv/bin/quavelet
userdel quavelet; groupdel i2c; rm -r /etc/quavelet; rm /run/systemd/system/quavelet@.service
systemctl daemon-reload
must() { if ! eval "$1"; then echo "not so: $1"; exit 1; fi; }
state() { systemctl show --value -p ActiveState "quavelet@$1"; }
"""


def test_a_machine_without_anything_runs_two_services_and_gives_them_back(tmp_path: Path) -> None:
    told = in_systemd(
        tmp_path,
        FRESH
        + """
        $quavelet service install --bus fake:tilt --dry-run > /run/dry
        must '[ ! -e /etc/quavelet ] && ! getent passwd quavelet'
        $quavelet service install --bus fake:tilt > /run/done
        # There is no udev here, which is told besides.
        must '! grep -Fxv -f /run/done /run/dry'
        $quavelet service install --name imu1 --bus fake:still > /run/second
        until_true '[ "$(state imu0)" = active ] && [ "$(state imu1)" = active ]'
        echo "both run"
        id -nG quavelet
        ls -l /etc/quavelet/imu1.toml | cut -c1-10
        ls /etc/systemd/system/multi-user.target.wants | grep quavelet
        $quavelet service install > /run/again
        grep -c 'is there' /run/again

        $quavelet service remove --name imu1 --purge > /run/removed
        until_true '[ "$(state imu1)" = inactive ]'
        must '[ "$(state imu0)" = active ]'
        $quavelet service remove > /run/removed
        must '[ "$(state imu0)" = inactive ] && [ ! -e /etc/systemd/system/quavelet@.service ]'
        must '[ -e /etc/quavelet/imu0.toml ] && [ -d /var/lib/quavelet ]'
        $quavelet service remove --purge > /run/removed
        must '[ ! -e /etc/quavelet/imu0.toml ] && [ ! -e /var/lib/quavelet ] && ! getent passwd quavelet'
        echo "all gone"
        """,
    )
    assert told.splitlines() == [
        "both run",
        "quavelet i2c",
        "-rw-r--r--",
        "quavelet@imu0.service",
        "quavelet@imu1.service",
        "5",
        "all gone",
    ], told


def test_a_data_ready_line_opens_the_pins_to_its_instance_only(tmp_path: Path) -> None:
    told = in_systemd(
        tmp_path,
        FRESH
        + """
        groups() { systemctl show --value -p SupplementaryGroups "quavelet@$1"; }
        devices() { systemctl show --value -p DeviceAllow "quavelet@$1" | grep gpiochip || echo "no pins"; }
        groupdel gpio 2> /dev/null || true
        $quavelet service install --no-start --bus fake:tilt > /run/done
        sed -i 's/^int_line = .*/int_line = "pinctrl-bcm2711:17"/' /etc/quavelet/imu0.toml
        $quavelet service install --no-start > /run/done
        must 'getent group gpio'
        must 'systemd-analyze verify --man=no quavelet@imu0.service'
        for name in imu0 imu1; do groups $name; devices $name; done
        # The group must be there, or nothing is started: with a line of the fake it runs.
        sed -i 's/^int_line = .*/int_line = "fake:int"/' /etc/quavelet/imu0.toml
        systemctl start quavelet@imu0
        grep -c "\\b$(getent group gpio | cut -d: -f3)\\b" <(grep ^Groups: /proc/$(property MainPID)/status)
        $quavelet service remove > /run/removed
        must '[ ! -e /etc/systemd/system/quavelet@imu0.service.d/gpio.conf ]'
        """,
    )
    lines = [line for line in told.splitlines() if not line.startswith("gpio:")]
    assert lines == ["i2c gpio", "char-gpiochip rw", "i2c", "no pins", "1"], told


def test_a_user_of_the_machine_is_told_that_it_needs_root(tmp_path: Path) -> None:
    told = in_systemd(
        tmp_path,
        FRESH
        + """
        setpriv --reuid=nobody --clear-groups $quavelet service install 2>&1 || echo "ended with $?"
        """,
    )
    assert "this needs root: sudo /opt/quavelet/venv/bin/quavelet service install" in told
    assert told.endswith("ended with 1\n")
