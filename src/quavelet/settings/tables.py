"""The tables of the settings file, one struct each, with their defaults and what each value must be."""

from __future__ import annotations

import msgspec

from quavelet.attitude.heading import HeadingParams
from quavelet.attitude.params import FilterParams
from quavelet.core.errors import SettingsError
from quavelet.core.mounting import AS_THE_CHIP, Axes, rotation
from quavelet.denoise.params import DenoiseParams
from quavelet.mpu6050.config import ChipConfig
from quavelet.mpu6050.magnetometer.asked import LONGEST_BYTES, MagnetometerParams
from quavelet.mpu6050.offset_settings import OffsetSettings
from quavelet.mpu6050.registers import FRAME_BYTES
from quavelet.settings.outputs import OutputSettings, output_faults
from quavelet.settings.service import RecordingSettings, ServiceSettings
from quavelet.settings.web import WebSettings


class BusSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the chip is.

    name        "linux:N" for /dev/i2c-N; on a Raspberry Pi the pins 3 and 5 are linux:1. "fake:NAME" is a fake chip,
                and says so
    address     0x68, or 0x69 with AD0 wired to 3.3 V
    accept_id   WHO_AM_I of a chip of this family that quavelet does not know and shall drive all the same, as an
                MPU-6500; 0: none
    int_line    the GPIO that the chip's INT pin is wired to, "LABEL:LINE" as `gpiodetect` shows them:
                "pinctrl-bcm2711:17" on a Raspberry Pi 4, "pinctrl-rp1:17" on a 5, "fake:int" on a fake bus. Samples are
                then timed to some microseconds. "": none
    """

    name: str = "linux:1"
    address: int = 0x68
    accept_id: int = 0
    int_line: str = ""

    def __post_init__(self) -> None:
        if not 0x00 <= self.accept_id <= 0xFE:
            raise SettingsError(f"accept_id = {self.accept_id} is no WHO_AM_I: give 0x01 to 0xfe, or 0 for none")
        if not 0x08 <= self.address <= 0x77:
            raise SettingsError(f"address = {self.address} is not a 7-bit device address: give 0x68 or 0x69")
        if self.int_line and not all(self.int_line.rpartition(":")[::2]):
            raise SettingsError(f"int_line = '{self.int_line}' is no line: write LABEL:LINE, as pinctrl-bcm2711:17")


class MountingSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How the chip lies in the body whose attitude is wanted.

    x, y, z   which axis of the chip, as printed on its board, points along the body's x, y and z: "+x", "-x", "+y",
              "-y", "+z" or "-z"
    """

    x: str = AS_THE_CHIP[0]
    y: str = AS_THE_CHIP[1]
    z: str = AS_THE_CHIP[2]

    def __post_init__(self) -> None:
        try:
            rotation(self.axes)
        except ValueError as error:
            raise SettingsError(str(error)) from error

    @property
    def axes(self) -> Axes:
        return self.x, self.y, self.z


class CalibrationSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Which calibration is used.

    file        its path; "": that of the chip, where there is one
    automatic   look for that of the chip, by its factory's trim, in ~/.config/quavelet/calibration and
                /etc/quavelet/calibration. One that does not fit, or is damaged, is told of and not used
    """

    file: str = ""
    automatic: bool = True


class StartSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How the gyroscope's bias is found.

    still_s         how long the board must lie still for its mean rate to be taken as the bias
    gyro_bias_dps   a bias known beforehand, x y z in deg/s, such as [1.2, -0.4, 0.1]; empty: measure it
    """

    still_s: float = 2.0
    gyro_bias_dps: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not 0.5 <= self.still_s <= 60.0:
            raise SettingsError(f"still_s = {self.still_s} does not fit: give 0.5 to 60 s")
        if len(self.gyro_bias_dps) not in (0, 3) or not all(abs(x) <= 50.0 for x in self.gyro_bias_dps):
            raise SettingsError("gyro_bias_dps takes three numbers within +-50 deg/s, or none")


class LoopSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The fixed-step loop, and real-time settings that are tried and reported.

    rate_hz          how often the FIFO is drained and a message goes out, in Hz; at least chip.sample_rate_hz / 35 (21
                     with a magnetometer), or the chip's FIFO overflows
    priority         SCHED_FIFO priority of the loop's thread; 0 leaves its scheduling alone. The unit allows 50
    lock_memory      keep the program's memory from being swapped out (mlockall)
    cpu_dma_latency  keep all processors out of deep idle states: wakes up sooner, costs power
    timer_slack      wake up to the nanosecond asked for, not up to 50 us later
    tune_gc          take all objects that exist at the start out of the garbage collector's sight, and let it look at
                     new ones rarely. It is not switched off: whatever makes reference cycles would then leak for as
                     long as the service runs
    switch_interval  make other Python threads hand over the interpreter within 0.1 ms, not the usual 5 ms
    """

    rate_hz: float = 100.0
    priority: int = 50
    lock_memory: bool = True
    cpu_dma_latency: bool = True
    timer_slack: bool = True
    tune_gc: bool = True
    switch_interval: bool = True

    def __post_init__(self) -> None:
        if not 1.0 <= self.rate_hz <= 1000.0:
            raise SettingsError(f"rate_hz = {self.rate_hz} does not fit: give 1 to 1000")
        if not 0 <= self.priority <= 99:
            raise SettingsError(f"priority = {self.priority} does not fit: give 0 (off) to 99")


class Settings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One table of the TOML file each; `output` has a table for each output, [output.NAME]."""

    bus: BusSettings = BusSettings()
    chip: ChipConfig = ChipConfig(gyro_range_dps=500, accel_range_g=4, dlpf=3, sample_rate_hz=200.0)
    offsets: OffsetSettings = OffsetSettings()
    mounting: MountingSettings = MountingSettings()
    magnetometer: MagnetometerParams = MagnetometerParams()
    calibration: CalibrationSettings = CalibrationSettings()
    start: StartSettings = StartSettings()
    denoise: DenoiseParams = DenoiseParams()
    filter: FilterParams = FilterParams()
    heading: HeadingParams = HeadingParams()
    loop: LoopSettings = LoopSettings()
    service: ServiceSettings = ServiceSettings()
    recording: RecordingSettings = RecordingSettings()
    web: WebSettings = WebSettings()
    output: dict[str, OutputSettings] = {}

    @property
    def frame_bytes(self) -> int:
        """Bytes of one frame of the chip's FIFO, at most."""
        return FRAME_BYTES + (LONGEST_BYTES if self.magnetometer.used else 0)

    def __post_init__(self) -> None:
        faults = [*self._too_slow(), *output_faults(self.output)]
        if faults:
            raise SettingsError("\n".join(faults))

    def _too_slow(self) -> list[str]:
        # A drain must come while the 1024-byte FIFO has room: 70 frames, with a magnetometer 42, and half of that for
        # late wake-ups.
        slowest = self.chip.sample_rate_hz / (21.0 if self.magnetometer.used else 35.0)
        if self.loop.rate_hz >= slowest:
            return []
        return [
            f"loop.rate_hz = {self.loop.rate_hz:g} is too slow for chip.sample_rate_hz = "
            f"{self.chip.sample_rate_hz:g}: the chip's FIFO would overflow; give {slowest:g} or more"
        ]
