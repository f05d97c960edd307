"""A chip that lies turned in its body: what a person is told, what is calibrated and what `run` gives agree."""

from __future__ import annotations

import itertools
import re

import msgspec
import numpy as np
import pytest
from session_rig import SETTINGS, Bench

from quavelet.attitude.heading import HeadingParams
from quavelet.bench.session import Session
from quavelet.bench.session_evidence import Evidence
from quavelet.bench.session_result import work_out
from quavelet.bench.session_words import in_words
from quavelet.calibration.calibrate import Calibrate
from quavelet.calibration.model import BiasCurve, ImuCalibration
from quavelet.calibration.record_file import save_record
from quavelet.core.blocks import RawBlock, Scale, concat
from quavelet.core.instruction import FACES, Instruction
from quavelet.core.units import DEG_PER_RAD, NS_PER_S
from quavelet.imu import Imu
from quavelet.pipeline import mounted, mounted_heading
from quavelet.settings import CalibrationSettings, MountingSettings

UNIT = {face: (1.0 if face[0] == "+" else -1.0) * np.eye(3)["xyz".index(face[1])] for face in FACES}
ROTATIONS = [
    axes
    for axes in itertools.product(FACES, repeat=3)
    if len({face[1] for face in axes}) == 3 and np.linalg.det([UNIT[face] for face in axes]) > 0.0
]


def settings_of(axes, **others):
    x, y, z = axes
    return msgspec.structs.replace(SETTINGS, mounting=MountingSettings(x=x, y=y, z=z), **others)


@pytest.mark.parametrize("axes", ROTATIONS, ids="".join)
def test_rates_and_forces_are_those_of_the_chip_turned_into_the_body(axes):
    rng = np.random.default_rng(5)

    def matrix(size):
        return tuple(tuple(row) for row in rng.normal(0.0, size, (3, 3)).tolist())

    calibration = ImuCalibration(
        gyro_bias_rad_s=(0.1, -0.2, 0.3),
        gyro_bias_curve=BiasCurve(
            reference_degc=25.0,
            coefficients_rad_s=((0.01, 0.02, -0.03), (1e-3, 2e-3, 3e-3)),
            lowest_degc=0.0,
            highest_degc=50.0,
            sigma_rad_s=1e-4,
            slope_sigma_rad_s_degc=1e-5,
        ),
        gyro_matrix=tuple(tuple(row) for row in (np.eye(3) + matrix(0.02)).tolist()),
        gyro_per_force=matrix(1e-3),
        accel_offset_m_s2=(0.2, -0.5, 0.7),
        accel_matrix=tuple(tuple(row) for row in (np.eye(3) + matrix(0.02)).tolist()),
    )
    n = 20
    raw = RawBlock(
        t_ns=np.arange(1, n + 1) * 10**7,
        period_s=np.full(n, 0.01),
        gap_ns=np.zeros(n, dtype=np.int64),
        flags=np.zeros(n, dtype=np.uint32),
        counts=rng.integers(-9000, 9000, (n, 7)).astype(np.int16),
        scale=Scale(1e-3, 1e-3, 1 / 340, 36.53),
    )
    chip, body = (Calibrate(one).process(raw) for one in (calibration, mounted(calibration, settings_of(axes))))
    to_body = np.array([UNIT[face] for face in axes])
    assert body.accel_m_s2 == pytest.approx(chip.accel_m_s2 @ to_body.T, abs=1e-12)
    assert body.gyro_rad_s == pytest.approx(chip.gyro_rad_s @ to_body.T, abs=1e-12)
    assert body.gyro_bias_rad_s == pytest.approx(chip.gyro_bias_rad_s @ to_body.T, abs=1e-12)


@pytest.mark.parametrize("axes", ROTATIONS, ids="".join)
def test_the_field_is_turned_with_the_chip_and_its_iron_stays_where_it_was_measured(axes):
    heading = HeadingParams(hard_iron_ut=(3.0, -4.0, 5.0), soft_iron=(1.1, 0.1, 0.0, 0.0, 0.9, 0.05, 0.0, 0.0, 1.0))
    turned = mounted_heading(settings_of(axes, heading=heading))
    field = np.array([10.0, 20.0, -30.0])
    chip, body = (np.array(one.soft_iron).reshape(3, 3) @ (field - one.hard_iron_ut) for one in (heading, turned))
    assert body == pytest.approx(np.array([UNIT[face] for face in axes]) @ chip)


class Mounted(Bench):
    """A bench whose person hears only the words, and knows only the body: how the chip lies in it is not his to see."""

    def __init__(self, names, *, axes, **others):
        super().__init__(names, **others)
        self.axes, self.to_body = axes, np.array([UNIT[face] for face in axes])
        self.session = Session(names, Evidence(chip=self.chip), axes=axes)
        self.heard: list[str] = []

    def ask(self, instruction: Instruction) -> None:
        words = in_words(instruction, self.axes)
        self.heard.append(words)
        if instruction.action != "face":
            self.bus.follow(instruction)
            return
        ((axis, way),) = re.findall(r"its ([XYZ]) axis, as it is mounted, points straight (up|down)", words)
        body_up = UNIT[("+" if way == "up" else "-") + axis.lower()]
        (chip_face,) = [face for face in FACES if np.allclose(self.to_body @ UNIT[face], body_up)]
        self.bus.follow(Instruction(action="face", face=chip_face))


@pytest.mark.parametrize("axes", [("+y", "-x", "+z"), ("-z", "+x", "-y")], ids="".join)
def test_a_session_by_the_words_of_the_body_gives_the_attitude_of_the_body(axes, tmp_path):
    bench = Mounted(["warm-up", "rest", "faces"], axes=axes, out=tmp_path / "s", seed=9)
    assert bench.conduct()
    assert [pose.face for pose in bench.evidence.placed] == [face for face in FACES for _ in range(2)]
    missing = next(view.status for view in bench.views if view.status.startswith("missing")).split()[1:]
    assert np.array_equal([UNIT[face] @ bench.to_body for face in missing], [UNIT[face] for face in FACES])
    record = work_out(bench.evidence, utc="2026-01-01T00:00:00Z", version="0").record
    save_record(record, tmp_path / "c.toml")
    settings = settings_of(axes, calibration=CalibrationSettings(file=str(tmp_path / "c.toml")))
    imu = Imu(bench.bus, settings=settings, clock=bench.clock)
    for instruction in (
        *(Instruction(action="face", face=face) for face in ("+z", "-x", "+y")),
        Instruction(action="pose"),
    ):
        bench.bus.follow(instruction)
        blocks = []
        for _ in imu.loop.deadlines(bench.clock.now_ns() + 10 * NS_PER_S):
            block = imu.read()
            if block is not None and len(block):
                blocks.append(block)
        w, x, y, z = concat(blocks).q[-1]
        # The world's vertical in the axes of the body, by the quaternion and by the truth of the fake.
        found = np.array([2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z])
        at_s = np.array([bench.bus.chip.world_time_s(bench.clock.now_ns())])
        true = bench.to_body @ bench.bus.motion.specific_force_m_s2(at_s)[0]
        angle = DEG_PER_RAD * np.arccos(min(1.0, float(found @ true / np.linalg.norm(true))))
        print(f"{''.join(axes)} {instruction.face or 'pose'} {angle:.3f} deg")
        assert angle < 0.3
