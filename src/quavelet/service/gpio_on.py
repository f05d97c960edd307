"""Whether the service may have a data-ready line on this machine, and what to do where it may not."""

from __future__ import annotations

import shlex
from importlib.util import find_spec
from pathlib import Path

from quavelet.service.i2c_on import is_open_to_group
from quavelet.service.program import Program

GROUP = "gpio"
RULE = f'SUBSYSTEM=="gpio", KERNEL=="gpiochip*", GROUP="{GROUP}", MODE="0660"'


def gpio_advice(program: Program, *, root: Path = Path("/")) -> list[str]:
    """What stands between the service and a GPIO line, a sentence each; none where all is well."""
    advice = []
    if find_spec("gpiod") is None:
        pip = shlex.quote(str(program.path.with_name("pip")))
        advice.append(f"the data-ready line needs the package gpiod: sudo {pip} install 'quavelet[gpio]'")
    chips = sorted((root / "dev").glob("gpiochip*"))
    if not chips:
        advice.append("there is no /dev/gpiochip*, so no data-ready line: has this machine GPIO pins?")
    elif not any(is_open_to_group(chip, GROUP) for chip in chips):
        advice.append(
            f"/dev/{chips[0].name} is not open to the group {GROUP}: "
            f"echo '{RULE}' | sudo tee /etc/udev/rules.d/61-gpio.rules, and reboot"
        )
    return advice
