"""Recorded raw counts in place of motion: what a real chip gave comes through the fake's FIFO byte for byte."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from hw_fakes.chip.samples import CountArray, Run
from hw_fakes.chip.setup import Setup
from hw_fakes.world.npz_file import arrays_in
from quavelet.core.errors import SettingsError
from quavelet.core.units import NS_PER_S

# Time is counted in outputs of a 32 kHz gyroscope by the chip's own clock, so that frames are found in whole numbers.
_UNITS_HZ = 32000


class RecordedCounts:
    """A `SampleSource` that plays recorded counts at their own speed, whatever rate the chip is set to.

    Recorded frame k is the k-th sample after the FIFO was first switched on; until then all samples are frame 0. At
    the recorded ranges and `nominal_hz` each frame comes out once, as it was. At another range counts are rescaled,
    rounded and clipped; at another rate a sample shows the frame of its time. Low-pass filter, self-test and offset
    registers do nothing to a recording.
    """

    def __init__(
        self,
        *,
        acc: CountArray,
        gyr: CountArray,
        temp: CountArray,
        acc_lsb_per_g: float,
        gyr_lsb_per_dps: float,
        rate_hz: float,
    ) -> None:
        """acc, gyr (N, 3) and temp (N,) int16 register counts, N >= 1; rate_hz as measured, not as configured."""
        self.frames: CountArray = np.column_stack([acc, temp, gyr]).astype(np.int16)
        self.acc_lsb_per_g = acc_lsb_per_g
        self.gyr_lsb_per_dps = gyr_lsb_per_dps
        self.rate_hz = rate_hz
        self.divider = max(1, round(1000 / rate_hz))
        self._anchor: tuple[Run, int] | None = None

    def __len__(self) -> int:
        """Recorded frames."""
        return len(self.frames)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """The recording in an npz file of acc, gyr, temp, acc_lsb_per_g, gyr_lsb_per_dps and rate (in Hz).

        Raises SettingsError, naming the file, where it cannot be read or lacks something.
        """
        arrays = arrays_in(path, named_after="fake:counts:")
        acc, gyr, temp = (_words(arrays, name, path) for name in ("acc", "gyr", "temp"))
        if not len(acc) == len(gyr) == len(temp) > 0:
            raise SettingsError(f"acc, gyr and temp in {path} are not of one length above 0: record it anew")
        return cls(
            acc=acc,
            gyr=gyr,
            temp=temp,
            acc_lsb_per_g=_number(arrays, "acc_lsb_per_g", path),
            gyr_lsb_per_dps=_number(arrays, "gyr_lsb_per_dps", path),
            rate_hz=_number(arrays, "rate", path),
        )

    @property
    def nominal_hz(self) -> float:
        """The rate to configure: the nearest that a divider makes of 1 kHz."""
        return 1000 / self.divider

    @property
    def oscillator_error(self) -> float:
        """The error of the chip's oscillator with which the nominal rate is truly the recorded one."""
        return self.rate_hz / self.nominal_hz - 1

    def words(self, run: Run, setup: Setup, chunk: int, /) -> CountArray:
        samples = np.arange(chunk * run.chunk, (chunk + 1) * run.chunk)
        frame = self._since_anchor(run, samples) // self._units_a_frame
        words = self.frames[np.clip(frame, 0, len(self) - 1)].astype(np.float64)
        words[:, :3] *= setup.accel_lsb_per_g / self.acc_lsb_per_g
        words[:, 4:] *= setup.gyro_lsb_per_dps / self.gyr_lsb_per_dps
        return np.clip(np.rint(words), -32768, 32767).astype(np.int16)

    def limit(self, run: Run, /) -> int | None:
        if self._anchor is None:
            return None
        first = int(self._since_anchor(run, np.array([-1]))[0])
        left = len(self) * self._units_a_frame - first
        return max(0, -(-left // _units_a_sample(run)) - 1)

    def fifo_begins(self, run: Run, sample: int, /) -> None:
        self._anchor = run, sample

    def forget(self) -> None:
        return

    @property
    def _units_a_frame(self) -> int:
        return self.divider * _UNITS_HZ // 1000

    def _since_anchor(self, run: Run, samples: NDArray[np.int64]) -> NDArray[np.int64]:
        """Time of samples of `run` since frame 0, in units; before there is a frame 0, all are 0."""
        if self._anchor is None:
            return np.zeros(len(samples), dtype=np.int64)
        first_run, first = self._anchor
        since: NDArray[np.int64] = (samples + 1) * _units_a_sample(run) - (first + 1) * _units_a_sample(first_run)
        if run is not first_run:
            unit_ns = NS_PER_S / (_UNITS_HZ * (1 + self.oscillator_error))
            since = since + round((run.start_ns - first_run.start_ns) / unit_ns)
        return since


def _units_a_sample(run: Run) -> int:
    return run.divider * _UNITS_HZ // run.nominal_hz


def _array(arrays: Mapping[str, NDArray[Any]], name: str, path: str | Path) -> NDArray[Any]:
    if name not in arrays:
        raise SettingsError(f"{path} has no '{name}': it is not a recording of raw counts")
    return arrays[name]


def _words(arrays: Mapping[str, NDArray[Any]], name: str, path: str | Path) -> CountArray:
    array = _array(arrays, name, path)
    shape = "(N,)" if name == "temp" else "(N, 3)"
    if array.ndim != (1 if name == "temp" else 2) or (name != "temp" and array.shape[1] != 3):
        raise SettingsError(f"'{name}' in {path} is not of shape {shape}: record it anew")
    if array.dtype != np.int16:
        raise SettingsError(f"'{name}' in {path} is {array.dtype}, not int16: store the register counts as they are")
    return array


def _number(arrays: Mapping[str, NDArray[Any]], name: str, path: str | Path) -> float:
    array = _array(arrays, name, path)
    if array.size != 1 or array.dtype.kind not in "iuf" or not 0 < float(array.reshape(-1)[0]) < np.inf:
        raise SettingsError(f"'{name}' in {path} is not one positive number: record it anew")
    return float(array.reshape(-1)[0])
