"""Which magnetometer is behind the chip: by address and id, never by what is printed on the board."""

from __future__ import annotations

from dataclasses import dataclass

from quavelet.bus.protocol import I2CBus
from quavelet.core.errors import BusError, DeviceMissing
from quavelet.mpu6050 import registers as r
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.magnetometer import akm, hmc5883l, qmc5883l
from quavelet.mpu6050.magnetometer.aux_registers import (
    aux_bus_kept,
    close_bypass,
    open_bypass,
)
from quavelet.mpu6050.magnetometer.kinds import KINDS, Kind
from quavelet.mpu6050.magnetometer.plan import AS_THE_CHIP, IN_PACKAGE, Matrix
from quavelet.mpu6050.variants import identify

QMC5883P_ADDRESS = 0x2C
ADDRESSES = (akm.ADDRESS, qmc5883l.ADDRESS, hmc5883l.ADDRESS, QMC5883P_ADDRESS)
_IN_PACKAGE = {0x68: akm.AK8975, 0x71: akm.AK8963, 0x73: akm.AK8963}
"""What the MPU-9150 (its WHO_AM_I is the MPU-6050's), MPU-9250 and MPU-9255 have in their package."""


@dataclass(frozen=True, slots=True)
class FoundMagnetometer:
    """A magnetometer that answers.

    outside  it is on the outer bus itself, so that it answers with the bypass closed: the chip's master cannot reach it
    to_body  rotation from its axes to the chip's, as far as can be known: only inside a package it can
    """

    kind: Kind
    outside: bool = False
    to_body: Matrix = AS_THE_CHIP

    @property
    def name(self) -> str:
        return self.kind.name

    @property
    def address(self) -> int:
        return self.kind.address


@dataclass(frozen=True, slots=True)
class MagnetometerFinding:
    """What a look behind the chip came to.

    magnetometer  the one to take; None where there is none, or more than one
    candidates    all that are known
    sentences     what its owner should hear: why there is none, what else answered, what to check
    """

    magnetometer: FoundMagnetometer | None
    candidates: tuple[FoundMagnetometer, ...]
    sentences: tuple[str, ...]


def find_magnetometer(chip: RegisterAccess, *, wanted: str | None = None, accept_id: int = 0) -> MagnetometerFinding:
    """Ask by the bypass who is there; sleep, bypass and master are afterwards as they were.

    Nothing is written to a chip that is not known (but the number of the register to read). Only AKM's two have the
    same id: once that is read, and while the chip is in power-down, BIT of CNTL1 is set, read and taken back, since it
    sticks in an AK8963 alone; a single measurement that is under way is lost. While the master was on, its samples
    pause. `wanted` is a name of `KINDS`, to choose between two; `accept_id` as in `identify`.

    Raises BusError, WrongChip where the chip itself is none of ours, ChipUnstable where it opens no
    bypass, ValueError for an unknown name.
    """
    if wanted is not None and wanted not in KINDS:
        raise ValueError(f"there is no magnetometer {wanted!r}: take one of {', '.join(KINDS)}")
    who_am_i = chip.read(r.WHO_AM_I)
    # A clock chip at this address must not be written to.
    identify(who_am_i, bus=chip.bus.name, address=chip.address, accept_id=accept_id)
    with aux_bus_kept(chip):
        close_bypass(chip)
        outside = {address for address in ADDRESSES if _asked(chip.bus, address, 0x00, 1) is not None}
        open_bypass(chip)
        kinds, sentences = _look(chip.bus)
    candidates = tuple(_found(kind, outside=kind.address in outside, who_am_i=who_am_i) for kind in kinds)
    sentences += [sentence for found in candidates for sentence in _remarks(found, who_am_i)]
    chosen = [found for found in candidates if wanted in (None, found.name)]
    if len(chosen) > 1:
        names = " and ".join(f"an {found.name} at 0x{found.address:02x}" for found in chosen)
        sentences.append(f"more than one magnetometer answers, {names}: say by its name which one to use")
    if wanted is not None and not chosen:
        sentences.append(f"no {wanted} answers behind the chip at 0x{chip.address:02x}: take what is there, or none")
    elif not candidates:
        asked = ", ".join(f"0x{address:02x}" for address in ADDRESSES)
        sentences.append(
            f"no magnetometer that is known answers behind the chip at 0x{chip.address:02x} (asked {asked}): a plain "
            f"GY-521 has none, and yaw stays relative"
        )
    return MagnetometerFinding(chosen[0] if len(chosen) == 1 else None, candidates, tuple(sentences))


def _look(bus: I2CBus) -> tuple[list[Kind], list[str]]:
    """The known chips on the wires, and a sentence about each that is not."""
    kinds: list[Kind] = []
    sentences: list[str] = []
    for look in (_at_akm, _at_qmc5883l, _at_hmc5883l, _at_qmc5883p):
        seen = look(bus)
        if isinstance(seen, Kind):
            kinds.append(seen)
        elif seen is not None:
            sentences.append(seen)
    return kinds, sentences


def _at_akm(bus: I2CBus) -> Kind | str | None:
    ids = _asked(bus, akm.ADDRESS, akm.WIA.address, 2)
    if ids is None:
        return None
    wia, info = ids
    if wia != akm.ID:
        return f"0x0c answers with 0x{wia:02x} where an AK8963 or AK8975 says 0x48: it is not known, and is not driven"
    if info in akm.LATER_AKM:
        return f"0x0c is an {akm.LATER_AKM[info]}, which this driver does not know, and is not driven"
    return KINDS[akm.AK8963 if _holds_16_bit(bus) else akm.AK8975]


def _holds_16_bit(bus: I2CBus) -> bool:
    """Whether AKM's chip is an AK8963: it keeps BIT of CNTL1. It goes on measuring if it was."""
    control = _read(bus, akm.ADDRESS, akm.CNTL.address)
    if control & akm.BIT:
        return True
    mode = control & akm.MODE
    if mode:
        bus.write(akm.ADDRESS, bytes([akm.CNTL.address, akm.POWER_DOWN]))
    bus.write(akm.ADDRESS, bytes([akm.CNTL.address, akm.POWER_DOWN | akm.BIT]))
    held = bool(_read(bus, akm.ADDRESS, akm.CNTL.address) & akm.BIT)
    # The two transfers since power-down took longer than the 100 us it has to last (DS 6.3).
    last = mode if held and mode in akm.CONTINUOUS_8963.values() else akm.POWER_DOWN
    bus.write(akm.ADDRESS, bytes([akm.CNTL.address, last]))
    return held


def _at_qmc5883l(bus: I2CBus) -> Kind | str | None:
    # Its id is what a line reads that nobody drives: other registers must have zeros where this chip has them.
    number = _asked(bus, qmc5883l.ADDRESS, qmc5883l.CHIP_ID.address, 1)
    if number is None:
        return None
    status = _read(bus, qmc5883l.ADDRESS, qmc5883l.STATUS.address)
    control = _read(bus, qmc5883l.ADDRESS, qmc5883l.CONTROL_2.address)
    if number[0] != qmc5883l.ID:
        return (
            f"0x0d answers with 0x{number[0]:02x} in register 0x0d where a QMC5883L has 0xff: it is not known, "
            f"and is not driven"
        )
    if status & qmc5883l.STATUS_RESERVED or control & qmc5883l.CONTROL_2_RESERVED:
        return (
            f"0x0d answers with ones where a QMC5883L has zeros (0x{status:02x}, 0x{control:02x}): if all addresses "
            f"answer so, the auxiliary lines float; check their pull-ups"
        )
    return KINDS[qmc5883l.NAME]


def _at_hmc5883l(bus: I2CBus) -> Kind | str | None:
    letters = _asked(bus, hmc5883l.ADDRESS, hmc5883l.IDENTIFICATION.address, len(hmc5883l.ID))
    if letters is None:
        return None
    if letters == hmc5883l.ID:
        return KINDS[hmc5883l.NAME]
    return (
        f"0x1e answers with {letters.hex(' ')} where an HMC5883L says 48 34 33: it may be one marked DA5883, which is "
        f"not known, and is not driven"
    )


def _at_qmc5883p(bus: I2CBus) -> Kind | str | None:
    number = _asked(bus, QMC5883P_ADDRESS, 0x00, 1)
    if number is None:
        return None
    if number[0] == 0x80:
        return "0x2c answers as a QMC5883P, sold as HMC5883L or marked DA5883, which is not known, and is not driven"
    return f"0x2c answers with 0x{number[0]:02x}: it is not known, and is not driven"


def _found(kind: Kind, *, outside: bool, who_am_i: int) -> FoundMagnetometer:
    in_package = not outside and _IN_PACKAGE.get(who_am_i) == kind.name
    return FoundMagnetometer(kind, outside, IN_PACKAGE if in_package else AS_THE_CHIP)


def _remarks(found: FoundMagnetometer, who_am_i: int) -> list[str]:
    remarks = []
    if found.outside:
        remarks.append(
            f"the {found.name} is on the outer bus, beside the chip: it is read by itself and not by the chip's master"
        )
    expected = _IN_PACKAGE.get(who_am_i)
    if found.address == akm.ADDRESS and found.name != expected and not found.outside:
        remarks.append(
            f"an {found.name} behind a chip whose WHO_AM_I is 0x{who_am_i:02x} is not as any package has it: "
            f"compare its axes with the chip's and give to_body"
        )
    return remarks


def _asked(bus: I2CBus, address: int, register: int, n: int) -> bytes | None:
    """`n` bytes from the register on; None where nobody answers, asked twice."""
    for _ in range(2):
        try:
            return bus.write_read(address, bytes([register]), n)
        except DeviceMissing:
            continue
        except BusError:
            # Perhaps the wires were disturbed; who has failed once more is told of.
            return bus.write_read(address, bytes([register]), n)
    return None


def _read(bus: I2CBus, address: int, register: int) -> int:
    return bus.write_read(address, bytes([register]), 1)[0]
