"""The factory's self-test codes, and the response each stands for."""

from __future__ import annotations

from dataclasses import dataclass

from quavelet.mpu6050 import registers as r
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.measuring import read_steadily
from quavelet.mpu6050.variants import Variant


@dataclass(frozen=True, slots=True)
class TrimCodes:
    """The codes of one chip, x y z; 0 where the factory wrote none."""

    accel: tuple[int, int, int]
    gyro: tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class Response:
    """What self-test adds to the output, x y z; None where the factory wrote no code."""

    accel_g: tuple[float | None, ...]
    gyro_dps: tuple[float | None, ...]


def read_codes(chip: RegisterAccess, *, variant: Variant) -> TrimCodes:
    """The codes of this chip. Raises BusError."""
    if variant.class_6500:
        gyro = read_steadily(chip, r.GYRO_SELF_TEST_6500, r.GYRO_SELF_TEST_6500.length)
        accel = read_steadily(chip, r.ACCEL_SELF_TEST_6500, r.ACCEL_SELF_TEST_6500.length)
        return TrimCodes((accel[0], accel[1], accel[2]), (gyro[0], gyro[1], gyro[2]))
    return codes_of_four(read_steadily(chip, r.SELF_TEST, r.SELF_TEST.length))


def codes_of_four(run: bytes) -> TrimCodes:
    """The codes in SELF_TEST_X, _Y, _Z and _A of an MPU-6050 (RM p. 9).

    The accelerometer's lie in two registers: three bits above the gyroscope's five, and two in SELF_TEST_A. Shifted by
    3 and not masked, as in a widespread library, two bits of the gyroscope's stay in them.
    """
    x, y, z, low = run
    return TrimCodes(
        accel=(
            x >> 3 & 0x1C | low >> 4 & 3,
            y >> 3 & 0x1C | low >> 2 & 3,
            z >> 3 & 0x1C | low & 3,
        ),
        gyro=(x & 0x1F, y & 0x1F, z & 0x1F),
    )


def expected_response(codes: TrimCodes, *, variant: Variant) -> Response:
    """The factory's own measurement, by the formula of this kind of chip."""
    if variant.class_6500:
        # The vendor's driver: 2620 * 1.01^(code - 1) LSB, at +-2 g and at +-250 deg/s.
        return Response(
            accel_g=tuple(2620 * 1.01 ** (n - 1) / 16384 if n else None for n in codes.accel),
            gyro_dps=tuple(2620 * 1.01 ** (n - 1) / 131 if n else None for n in codes.gyro),
        )
    # RM p. 10 and 11: 4096 * 0.34 * (0.92 / 0.34)^((n - 1) / 30) LSB at +-8 g, and 25 * 131 * 1.046^(n - 1) LSB at
    # +-250 deg/s, of which y is negative.
    return Response(
        accel_g=tuple(0.34 * (0.92 / 0.34) ** ((n - 1) / 30) if n else None for n in codes.accel),
        gyro_dps=tuple(
            sign * 25 * 1.046 ** (n - 1) if n else None for sign, n in zip((1, -1, 1), codes.gyro, strict=True)
        ),
    )
