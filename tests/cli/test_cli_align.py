"""`quavelet align`: roll and pitch of a still board, heading refused with figures, a moving board refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from program import quavelet

from hw_fakes import NOISE_ONLY, FakeBus, FakeMpu6050, Still, board
from hw_fakes.magnetometers.base import MagnetometerImperfections
from quavelet.alignment.result import Alignment, Heading
from quavelet.attitude.heading import HeadingParams
from quavelet.cli import exits
from quavelet.cli.align import Aligned, aligned_by, listen, message
from quavelet.core.clock import VirtualClock
from quavelet.core.euler import from_euler
from quavelet.core.units import NS_PER_S
from quavelet.mpu6050.magnetometer.asked import MagnetometerParams
from quavelet.settings import Settings


def test_a_still_board_gets_roll_and_pitch_and_the_reason_why_no_heading():
    done = quavelet("align", "--bus", "fake:still", "--virtual-time")
    assert (done.code, done.err) == (exits.OK, "")
    assert [line.split()[0] for line in done.lines] == ["roll", "pitch", "heading", "from"]
    assert "+- 2." in done.lines[0]
    assert "0.01 deg/s of gyroscope error in 0.0042 deg/s of horizontal earth rate" in done.lines[2]
    assert "NOT A REAL ONE" in done.lines[3]


def beside_a_magnetometer(*, heading_ccw_deg: float, **heading) -> Aligned:
    """Eight seconds of a still GY-87, pitched by 5 deg, through its registers."""
    clock = VirtualClock(5 * NS_PER_S)
    iron = MagnetometerImperfections(hard_iron_ut=(14.0, -22.0, 9.0), noise_ut=0.3)
    bought, lies = board("gy-87-hmc5883l"), Still(pitch_deg=5.0, yaw_deg=heading_ccw_deg)
    aux = bought.aux_master(clock, lies, imperfections=iron)
    chip = FakeMpu6050(clock, motion=lies, imperfections=NOISE_ONLY, personality=bought.personality, aux=aux)
    settings = Settings(magnetometer=MagnetometerParams(use="auto"), heading=HeadingParams(**heading))
    with FakeBus({0x68: chip, **aux.outside()}, clock=clock) as bus:
        found = listen(bus, settings, clock=clock, duration_s=8.0)
    return aligned_by(found, settings, src="fake:gy-87", latitude_deg=None)


def test_a_calibrated_magnetometer_behind_the_chip_gives_heading():
    for ccw in (0.0, 130.0):
        found = beside_a_magnetometer(heading_ccw_deg=ccw, hard_iron_ut=(14.0, -22.0, 9.0), declination_deg=4.0)
        assert (found.heading, found.north) == ("observed", "true")
        # Where yaw is 0, x is east and y north.
        assert (found.heading_deg + ccw + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=0.5)
        assert found.pitch_deg == pytest.approx(5.0, abs=0.1)
        assert found.sigma_deg[2] < 8.0


def test_a_magnetometer_that_is_not_calibrated_gives_no_heading():
    found = beside_a_magnetometer(heading_ccw_deg=0.0)
    assert (found.heading, found.heading_deg) == ("earth_rate_hidden", None)
    assert "no calibrated magnetometer" in found.reason


def test_roll_of_a_board_on_its_nose_is_hardly_known():
    q = from_euler(np.radians([10.0, 88.0, 0.0]))
    tilt = np.radians(2.3)
    found = message(Alignment(q, np.array([tilt, tilt, 1.8]), Heading.NO_REFERENCE, ""), src="", still_s=9.0, samples=9)
    assert found.roll_sigma_deg == pytest.approx(2.3 / np.cos(np.radians(88.0)), rel=1e-3)
    assert found.sigma_deg[:2] == pytest.approx((2.3, 2.3))


def test_a_moving_board_is_refused():
    done = quavelet("align", "--bus", "fake:sway", "--virtual-time")
    assert (done.code, done.err) == (exits.VERDICT_FAILED, "")
    assert done.lines[0].startswith("refused  the board moved: it lay still for 0.0 s of")
    assert "lay it down" in done.lines[0]
    (refused,) = quavelet("align", "--bus", "fake:sway", "--virtual-time", "--json").lines
    assert json.loads(refused)["aligned"] is False
    assert "q" not in json.loads(refused)


def test_the_json_has_the_attitude_and_the_sigma_of_a_heading_unknown(recording: Path):
    done = quavelet("align", recording, "--json", "--latitude", -45)
    assert done.code == exits.OK, done.err
    (line,) = done.lines
    found = json.loads(line)
    assert (found["v"], found["aligned"], found["heading"]) == (1, True, "earth_rate_hidden")
    assert found["src"] == "replay:fake:tilt"
    assert found["sigma_deg"][2] == pytest.approx(103.92, abs=0.01)
    assert "0.0030 deg/s of horizontal earth rate" in found["reason"]
    assert "heading_deg" not in found
    assert found["samples"] == pytest.approx(found["still_s"] * 200, rel=0.05)


def test_a_recording_aligns_as_the_chip_did_live(recording: Path):
    """The first still seconds of the same fake: the same samples."""
    live = json.loads(quavelet("align", "--bus", "fake:tilt", "--virtual-time", "--duration", 5, "--json").out)
    replayed = json.loads(quavelet("align", recording, "--json").out)
    for angle in ("roll_deg", "pitch_deg"):
        assert replayed[angle] == pytest.approx(live[angle], abs=0.02)


def test_a_recording_cut_short_is_aligned_and_said_to_be_damaged(recording: Path, tmp_path: Path):
    whole = recording.read_bytes()
    cut = tmp_path / "cut.qrec"
    cut.write_bytes(whole[: len(whole) - 7])
    done = quavelet("align", cut)
    assert done.code == exits.FAILED
    assert done.lines[0].startswith("roll")
    assert len(done.said) == 1


def test_what_cannot_be_done_is_said_in_a_sentence():
    for arguments, code, said in (
        (["x.qrec", "--bus", "fake:still"], exits.USAGE, "leave --bus"),
        (["no-such.qrec"], exits.FAILED, "there is no recording"),
        (["--bus", "fake:still", "--address", "0x69", "--virtual-time"], exits.NO_DEVICE, "0x69"),
        (["--latitude", "91"], exits.USAGE, "less than or equal to 90"),
    ):
        done = quavelet("align", *arguments)
        assert (done.code, done.out) == (code, "")
        assert said in " ".join(done.said)


def test_a_board_unplugged_meanwhile_is_lost(with_odd_buses: dict[str, str]):
    done = quavelet("align", "--bus", "odd:dying", "--duration", 5, env=with_odd_buses)
    assert done.code == exits.DEVICE_LOST
    assert done.said
