"""Is the chip within reach: the bus, who answers on it, and what sits where an MPU-6050 should."""

from __future__ import annotations

from quavelet.bench import wires
from quavelet.bench.finding import Finding
from quavelet.bench.host import Host, linux_number, others
from quavelet.bus.protocol import I2CBus
from quavelet.core.errors import BusBusy, BusError, BusPermission, DeviceMissing, ImuError, WrongChip
from quavelet.mpu6050.variants import VARIANTS
from quavelet.settings import BusSettings


class Reach:
    """The way to one chip.

    error   why it is not within reach, None where it is or nobody has looked yet
    """

    def __init__(self, settings: BusSettings, *, host: Host) -> None:
        self.error: ImuError | None = None
        self._name = settings.name
        self._address = settings.address
        self._number = linux_number(settings.name)
        self._buses = host.buses() if self._number is not None else []
        self._host = host

    @property
    def set_hz(self) -> int | None:
        """The bus's clock as the device tree asks for it."""
        return next((bus.clock_hz for bus in self._buses if bus.number == self._number), None)

    def opened(self, bus: I2CBus) -> Finding:
        if self._number is None:
            return Finding(name="bus", ok=True, found=f"{bus.name} is open")
        here = next((str(b) for b in self._buses if b.number == self._number), bus.name)
        also = others(self._buses, self._number)
        return Finding(name="bus", ok=True, found=f"{here} is open" + (f"; there are also {also}" if also else ""))

    def not_opened(self, error: BusError) -> Finding:
        found = f"{self._name} cannot be opened"
        also = others(self._buses, self._number)
        if isinstance(error, DeviceMissing):
            found = f"there is no I2C bus {self._name}; " + (f"there are {also}" if also else "this machine has none")
            if also:
                return Finding(name="bus", ok=False, found=found, advice=f"give one of them as --bus ({error})")
        elif isinstance(error, BusPermission):
            found = f"this user may not open {self._name}"
        return Finding(name="bus", ok=False, found=found, advice=str(error))

    def who_answers(self, bus: I2CBus) -> Finding:
        try:
            scan = wires.scan(bus, address=self._address)
        except BusError as error:
            self.error = error
            return Finding(name="who answers", ok=False, found="nobody can: the bus does not move", advice=str(error))
        if self._address in scan.answers:
            return Finding(name="who answers", ok=True, found=str(scan))
        here = f"0x{self._address:02x}"
        refused = scan.refused.get(self._address)
        if isinstance(refused, BusBusy):
            self.error = refused
            return self._held(refused)
        self.error = refused or DeviceMissing(f"no answer from {here}", address=self._address)
        if refused:
            return Finding(name="who answers", ok=False, found=f"{here} gives errors", advice=str(refused))
        found = f"{here} is silent; " + (f"there are {scan}" if scan.answers else "nobody answers on this bus")
        other = next((a for a in wires.MPU_ADDRESSES if scan.answers.get(a) in VARIANTS), None)
        if other is not None:
            found = f"{here} is silent, 0x{other:02x} answers with WHO_AM_I 0x{scan.answers[other]:02x}"
            advice = f"AD0 is {'high' if other == 0x69 else 'low'}: give --address 0x{other:02x}"
        elif scan.answers:
            advice = "the wires are well up to these: check VCC, GND and AD0 (low = 0x68, high = 0x69) of this board"
        else:
            advice = "check, in this order: VCC 3.3 V and GND, SDA and SCL not swapped, the solder of the pins"
            if also := others(self._buses, self._number):
                advice += f", and whether it is on another bus ({also})"
        return Finding(name="who answers", ok=False, found=found, advice=advice)

    def _held(self, error: BusBusy) -> Finding:
        device, driver = self._host.holder(self._number, self._address) if self._number is not None else ("", "")
        held = f"0x{self._address:02x} is held by the kernel's driver {driver or 'of this address'}"
        held += f" for {device}" if device else ""
        advice = str(error)
        if "mpu6050" in device or "mpu6050" in driver:
            advice = (
                "take dtoverlay=mpu6050 out of /boot/firmware/config.txt and reboot; "
                "until then: sudo modprobe -r inv_mpu6050_i2c"
            )
        elif driver.startswith("rtc") or device.startswith("ds"):
            advice = "a clock chip has this address: wire AD0 of the MPU-6050 to 3.3 V and give --address 0x69"
        return Finding(name="who answers", ok=False, found=held, advice=advice)

    def wrong_chip(self, bus: I2CBus, error: WrongChip | BusError) -> Finding:
        found = f"0x{error.found:02x}, which is no MPU-6050's" if isinstance(error, WrongChip) else "cannot be read"
        try:
            clock_chip = wires.looks_like_clock(bus.write_read(self._address, b"\x00", 7))
        except BusError:
            clock_chip = False
        if clock_chip:
            found = f"0x{self._address:02x} is a clock chip, a DS1307 or DS3231: its registers tell the time"
            advice = "take the clock off, or wire AD0 of the MPU-6050 to 3.3 V and give --address 0x69"
            return Finding(name="WHO_AM_I", ok=False, found=found, advice=advice)
        return Finding(name="WHO_AM_I", ok=False, found=found, advice=str(error))
