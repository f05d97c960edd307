"""Whether a Raspberry Pi's I2C bus is switched on, and what to do where it is not."""

from __future__ import annotations

import grp
import stat
from pathlib import Path

CONFIG_FILES = ("boot/firmware/config.txt", "boot/config.txt")
"""Of the firmware, from Raspberry Pi OS 12 on and before."""
FAST_HZ = 400_000
GROUP = "i2c"
_SWITCHES = ("i2c_arm", "i2c", "i2c1")
_CLOCKS = ("i2c_arm_baudrate", "i2c_baudrate", "i2c1_baudrate")


def i2c_advice(number: int, *, root: Path = Path("/")) -> list[str]:
    """What stands between /dev/i2c-`number` and its use, a sentence each; none where all is well."""
    device = f"/dev/i2c-{number}"
    there = (root / device[1:]).exists()
    if there and not is_open_to_group(root / device[1:], GROUP):
        return [f"{device} is not open to the group i2c: sudo apt install i2c-tools, and reboot"]
    firmware = next((root / name for name in CONFIG_FILES if (root / name).is_file()), None)
    if firmware is None:
        return [] if there else [f"there is no {device}: switch the bus on, and load its driver: modprobe i2c-dev"]
    shown = "/" + str(firmware.relative_to(root))
    asked = _dtparams(firmware)
    on = any(asked.get(name) in ("on", "yes", "true", "1", "") for name in _SWITCHES)
    if not there and number == 1 and not on:
        return [f"I2C is off, dtparam=i2c_arm=on is not in {shown}: sudo raspi-config nonint do_i2c 0, and reboot"]
    if not there:
        return [f"there is no {device}: sudo modprobe i2c-dev; where that does not help, reboot"]
    clock = next((asked[name] for name in _CLOCKS if name in asked), "100000")
    if number == 1 and (not clock.isdecimal() or int(clock) < FAST_HZ):
        return [f"the bus is slow: add the line dtparam=i2c_arm_baudrate={FAST_HZ} to {shown}, and reboot"]
    return []


def is_open_to_group(device: Path, group: str) -> bool:
    """Whether that group may use it, as a udev rule has it; what is no device is not asked."""
    found = device.stat()
    if not stat.S_ISCHR(found.st_mode):
        return True
    try:
        return grp.getgrgid(found.st_gid).gr_name == group and found.st_mode & 0o060 == 0o060
    except KeyError:
        return False


def _dtparams(path: Path) -> dict[str, str]:
    """What the lines `dtparam=name=value,name=value` ask for; the last one holds."""
    asked: dict[str, str] = {}
    for line in path.read_text(errors="replace").splitlines():
        key, _, rest = line.strip().partition("=")
        for word in rest.split(",") if key.strip() == "dtparam" else ():
            name, _, value = word.strip().partition("=")
            asked[name] = value.strip()
    return asked
