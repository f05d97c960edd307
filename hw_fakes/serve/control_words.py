"""What a line on the control socket does to the fake, and what it answers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hw_fakes.chip.mpu6050 import FakeMpu6050
from hw_fakes.faults.base import Happened
from hw_fakes.faults.of_chip import Unplugged
from hw_fakes.faults.plan import parse
from hw_fakes.scenarios import motion_named
from hw_fakes.wire.adapter import Adapter
from hw_fakes.world.motion_switched import SwitchedMotion
from quavelet.core.errors import SettingsError
from quavelet.core.euler import to_euler

HELP = """\
motion NAME [ADDRESS]  turn the board within 1.5 s to where the motion NAME begins, and follow that
fault TEXT             a fault: now, or when TEXT says, as `nack for=2` or `flip every=10 register=0x74`
clear                  forget all faults to come and end those that last
history [N]            what happened, the last N
unplug [ADDRESS]       take the chip off the wires
plug [ADDRESS]         and put it on again
state                  time, truth and registers of each chip, faults
help                   these lines"""


class ControlWords:
    """The commands on one adapter, whose clock the chips have; each is one line, without its end."""

    def __init__(self, adapter: Adapter) -> None:
        self._adapter = adapter
        self._commands: dict[str, Callable[[str], str]] = {
            "motion": self._motion,
            "fault": self._fault,
            "clear": self._clear,
            "history": self._history,
            "unplug": self._unplug,
            "plug": self._plug,
            "state": self._state,
            "help": self._help,
        }

    def answer(self, line: str) -> str:
        """`ok` and what there is to say, on one line or more, or `error` and one sentence."""
        word, _, rest = line.strip().partition(" ")
        command = self._commands.get(word)
        if command is None:
            return f"error there is no command '{word}': take one of {', '.join(self._commands)}"
        try:
            return f"ok {command(rest.strip())}".rstrip()
        except ValueError as error:
            return f"error {error}"
        except Exception as error:  # noqa: BLE001  whoever asks must not end what is served
            return f"error the fake failed: {error!r}"

    def _motion(self, rest: str) -> str:
        name, _, last = rest.rpartition(" ")
        name, address = (name.strip(), last) if name and last.startswith("0x") else (rest, "")
        motion = motion_named(name)  # a file takes its time, and the chips are not to wait for it
        with self._adapter.lock:
            chips = self._chips(address)
            for at, chip in chips.items():
                if not isinstance(chip.motion, SwitchedMotion):
                    raise SettingsError(
                        f"the chip at 0x{at:02x} does not move, it plays what was recorded: serve another"
                    )
            for chip in chips.values():
                assert isinstance(chip.motion, SwitchedMotion)
                chip.motion.switch(motion, chip.world_time_s(chip.clock.now_ns()))
                chip.recompute()
        return f"{name} at {_list(chips)}"

    def _fault(self, rest: str) -> str:
        entry = parse(rest)
        with self._adapter.lock:
            self._adapter.faults.add(entry)
        return str(entry)

    def _clear(self, rest: str) -> str:
        _nothing(rest, "clear")
        with self._adapter.lock:
            self._adapter.faults.clear()
        return ""

    def _history(self, rest: str) -> str:
        if rest and not rest.isdecimal():
            raise SettingsError(f"'{rest}' is no number of faults: write history, or history 10")
        with self._adapter.lock:
            self._adapter.faults.catch_up()
            happened = list(self._adapter.faults.history)
        shown = happened[max(0, len(happened) - int(rest)) :] if rest else happened
        return "\n".join([f"{len(happened)} happened", *map(self._told, shown)])

    def _unplug(self, rest: str) -> str:
        with self._adapter.lock:
            chips = self._chips(rest)
            for at in chips:
                self._adapter.faults.now(Unplugged(), address=at)
        return f"off the wires: {_list(chips)}"

    def _plug(self, rest: str) -> str:
        with self._adapter.lock:
            chips = self._chips(rest)
            ended = [at for at in chips if self._adapter.faults.end(Unplugged, address=at)]
        if not ended:
            raise SettingsError("nothing is unplugged")
        return f"on the wires: {_list(ended)}"

    def _state(self, rest: str) -> str:
        _nothing(rest, "state")
        faults = self._adapter.faults
        with self._adapter.lock:
            faults.catch_up()
            lines = [f"time_s={faults.time_s():.3f} transfers={self._adapter.transfers} happened={len(faults.history)}"]
            lines += [self._chip_state(at, chip) for at, chip in self._chips("").items()]
            lines += [f"lasts {fault.name} 0x{at:02x}" for fault, at in faults.lasting]
            lines += [f"plan {entry}" for entry in faults.plan]
        return "\n".join(lines)

    def _help(self, _rest: str) -> str:
        return f"\n{HELP}"

    def _chip_state(self, address: int, chip: FakeMpu6050) -> str:
        chip.int_level()  # lets happen what fell until now
        words = [
            f"0x{address:02x} chip={chip.personality.name} awake={int(chip.run is not None)}",
            f"rate_hz={chip.true_rate_hz():.3f} samples={chip.samples_taken} fifo={len(chip.fifo)}",
        ]
        if chip.motion is not None:
            t_s = np.array([chip.world_time_s(chip.clock.now_ns())])
            angles = np.degrees(to_euler(chip.motion.attitude(t_s)))[0]
            rates = np.degrees(chip.motion.rate_rad_s(t_s))[0]
            names = ("roll_deg", "pitch_deg", "yaw_deg", "x_deg_s", "y_deg_s", "z_deg_s")
            # + 0.0 makes of -0.0 what people expect.
            words += [f"{name}={round(v, 2) + 0.0:.2f}" for name, v in zip(names, (*angles, *rates), strict=True)]
        return " ".join(words)

    def _chips(self, address: str) -> dict[int, FakeMpu6050]:
        """The chips at an address, or all."""
        chips = {at: chip for at, chip in sorted(self._adapter.targets.items()) if isinstance(chip, FakeMpu6050)}
        if not address:
            return chips
        try:
            at = int(address, 0)
        except ValueError:
            raise SettingsError(f"'{address}' is no address: write one as 0x68") from None
        if at not in chips:
            raise SettingsError(f"there is no chip at 0x{at:02x}: take {_list(chips)}")
        return {at: chips[at]}

    def _told(self, one: Happened) -> str:
        places = [
            f"{name}={value:#04x}" if name == "register" else f"{name}={value}"
            for name in ("register", "byte", "bit")
            if (value := getattr(one.touch, name)) is not None
        ]
        time_s = self._adapter.faults.time_s(one.t_ns)
        return " ".join([f"{time_s:.6f} {one.kind.name} 0x{one.address:02x}", *places, one.touch.what])


def _list(addresses: dict[int, FakeMpu6050] | list[int]) -> str:
    return ", ".join(f"0x{at:02x}" for at in addresses)


def _nothing(rest: str, command: str) -> None:
    if rest:
        raise SettingsError(f"{command} takes nothing more, not '{rest}'")
