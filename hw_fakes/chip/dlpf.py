"""The digital low-pass filter of the gyroscope and accelerometer, as finite impulse responses.

The data sheet gives only a bandwidth and a delay for each setting (RM register 26), so the shape is chosen: a gamma
density (n + 1/2)^(shape - 1) exp(-(n + 1/2)/scale), which is a row of equal one-pole filters where the shape is
a whole number. Its two parameters meet both figures for settings 0 to 4. They cannot for settings 5 and 6, where
the delay printed is shorter than one pole's of that bandwidth; there the bandwidth is met by one pole, whose delay is
15.4 ms (printed 13.4 and 13.8) and 31.3 ms (printed 18.6 and 19.0). A pole with a direct path beside it would meet
setting 5, but let through all that is faster at -14.5 dB, and at 5 Hz it has 22.5 ms or more; a resonance would meet
both, with peaks of 5 and 8 dB: none of them is what one takes for the low-pass filter of such a chip.
The accelerometer's delay at setting 0 is 0.35 ms (printed 0).
"""

from __future__ import annotations

from functools import lru_cache
from math import ceil

import numpy as np
from numpy.typing import NDArray

# (shape, scale in samples), fitted to the table of RM register 26: bandwidth Hz and delay ms beside.
_GYRO = (
    (3.686, 2.2625),  # 256  0.98, at 8 kHz
    (12.018, 0.2005),  # 188  1.9
    (5.558, 0.5932),  # 98  2.8
    (2.470, 2.1515),  # 42  4.8
    (1.370, 6.4513),  # 20  8.3
    (1.0, 15.9207),  # 10
    (1.0, 31.8336),  # 5
)
_ACCEL = (
    (1.0, 0.7394),  # 260
    (12.235, 0.2047),  # 184  2.0
    (5.785, 0.6048),  # 94  3.0
    (2.852, 1.8950),  # 44  4.9
    (1.655, 5.4567),  # 21  8.5
    (1.0, 15.9207),  # 10
    (1.0, 31.8336),  # 5
)
# Of the 6500 class, by DLPF_CFG and at 8 and 9 by FCHOICE_B (RM9250 register 26); at 7 three taps meet both figures.
_OWN_GYRO = (
    (3.422, 2.4139),  # 250  0.97, at 8 kHz
    (22.450, 0.1516),  # 184  2.9
    (8.977, 0.4902),  # 92  3.9
    (3.548, 1.8034),  # 41  5.9
    (2.093, 4.9785),  # 20  9.9
    (1.522, 12.0718),  # 10  17.85
    (1.216, 27.9594),  # 5  33.48
    (0.0, 0.0),  # 3600  0.17, at 8 kHz
    (21.851, 0.1153),  # 8800  0.064, at 32 kHz
    (11.284, 0.3563),  # 3600  0.11, at 32 kHz
)
_THREE_TAPS = np.array([-0.1027, 0.8454, 0.2573])
# Of the 6500 class, by A_DLPF_CFG (RM9250 register 29); its delays at 5 and 6 are those of one pole. Setting 7, 420 Hz,
# is taken as no filter, since samples come at 1 kHz.
_OWN_ACCEL = (
    (12.235, 0.1727),  # 218.1  1.88
    (12.235, 0.1727),  # 218.1  1.88
    (5.785, 0.5743),  # 99  2.88
    (2.852, 1.8612),  # 44.8  4.88
    (1.655, 5.4052),  # 21.2  8.87
    (1.0, 15.6085),  # 10.2  16.83
    (1.0, 31.5184),  # 5.05  32.48
    (1.0, 0.05),
)
_OWN = {"own gyro": _OWN_GYRO, "own accel": _OWN_ACCEL}


@lru_cache(maxsize=32)
def taps(sensor: str, setting: int) -> NDArray[np.float64]:
    """The impulse response of "gyro", "accel", "own gyro", "own accel" or "none", newest sample first, sum 1.

    At settings 0 and 7 a gyroscope's is for 8 kHz, at 8 and 9, which only "own gyro" has, for 32 kHz; all others are
    for 1 kHz. "gyro" and "accel" take 7, which is reserved, as 0.
    """
    if sensor == "none":
        return np.ones(1)
    if sensor == "own gyro" and setting == 7:
        return _THREE_TAPS
    if sensor in _OWN:
        shape, scale = _OWN[sensor][setting]
    else:
        shape, scale = (_GYRO if sensor == "gyro" else _ACCEL)[setting % 7]
    n = np.arange(max(8, ceil((shape + 16) * scale))) + 0.5
    response: NDArray[np.float64] = n ** (shape - 1) * np.exp(-n / scale)
    response /= response.sum()
    return response
