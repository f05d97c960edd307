"""Yaw set to zero while the service runs, from another thread than the loop's, and kept over a restart."""

from __future__ import annotations

from pathlib import Path
from time import monotonic, sleep

import msgspec
import pytest
from service_bed import Bed, EventClock
from waiting import eventually

from hw_fakes import FakeBus, FakeMpu6050, Still, Turntable
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import NotPossible
from quavelet.core.units import NS_PER_S
from quavelet.imu import Imu
from quavelet.pipeline import build_pipeline
from quavelet.service.page_zero import ZeroAbility
from quavelet.service.saved_state import NoState, pack_pipeline, read_state, unpack_pipeline
from quavelet.settings import BusSettings, Settings
from quavelet.web.ability import Ability

PLAIN = Settings(bus=BusSettings(name="fake:bed"))
BOUND_S = 20.0
ENVIRON = {"QUAVELET_BOOT_ID": "c0ffee" + 26 * "0"}


def zero_of(bed: Bed) -> ZeroAbility:
    return ZeroAbility(lambda: bed.service.imu)


def test_yaw_reads_zero_from_the_next_message_and_what_it_was_after_the_undo() -> None:
    bed = Bed(Turntable(start_s=3.0, turn_deg=90.0))
    zero: Ability = zero_of(bed)
    seen: list[object] = []
    bed.clock.at(10.0, lambda: seen.append(zero.do("now", {})))
    bed.clock.at(11.0, lambda: seen.append(zero.state()))
    bed.clock.at(12.0, lambda: seen.append(zero.do("undo", {})))
    bed.run(until_s=13.0)
    yaw = {round(m.t_ns / 1e9, 1): (m.yaw_deg, m.sigma_deg[2]) for m in bed.messages}
    assert abs(yaw[9.5][0] - 90.0) < 3.0
    assert yaw[10.5][0] == pytest.approx(0.0, abs=0.05)
    assert yaw[12.5][0] == pytest.approx(yaw[9.5][0], abs=0.05)
    assert yaw[10.5][1] < 0.1 < yaw[9.5][1] <= yaw[12.5][1]
    assert seen[0] == "yaw counts from here"
    assert seen[1].possible and seen[1].zeroed_deg == pytest.approx(yaw[9.5][0], abs=0.05)  # type: ignore[attr-defined]
    assert zero.state().zeroed_deg is None  # type: ignore[attr-defined]


def test_it_is_refused_with_the_reason_before_there_is_an_attitude_and_while_yaw_may_begin_anew() -> None:
    bed = Bed(Still())
    zero = zero_of(bed)
    with pytest.raises(NotPossible, match="no chip yet"):
        zero.do("now", {})
    assert not zero.state().possible and "no chip yet" in zero.state().why
    refused: list[str] = []

    def ask() -> None:
        with pytest.raises(NotPossible) as error:
            zero.do("now", {})
        refused.append(str(error.value))

    bed.clock.at(1.0, ask)
    bed.run(until_s=4.0)
    assert "lie still" in refused[0]
    assert zero.state().possible
    with pytest.raises(NotPossible, match="no zero"):
        zero.do("undo", {})
    with pytest.raises(ValueError, match='"now"'):
        zero.do("../../etc/passwd", {"x": 1})


def test_a_zero_is_still_there_after_a_restart(tmp_path: Path) -> None:
    environ = {**ENVIRON, "RUNTIME_DIRECTORY": str(tmp_path)}
    before = Bed(Turntable(start_s=3.0, turn_deg=90.0), settings=PLAIN, environ=environ)
    zero = zero_of(before)
    before.clock.at(12.0, lambda: zero.do("now", {}))
    before.run(until_s=14.0)
    after = Bed(Turntable(start_s=3.0, turn_deg=90.0), settings=PLAIN, environ=environ, clock=EventClock(18.0))
    after.run(until_s=20.0)
    assert any("goes on from where it was" in line for line in after.said)
    assert after.messages[-1].yaw_deg == pytest.approx(0.0, abs=0.5)
    assert zero_of(after).state().zeroed_deg == zero.state().zeroed_deg is not None


def test_a_zero_is_in_the_state_file_at_once(tmp_path: Path) -> None:
    bed = Bed(Still(), settings=PLAIN, environ={**ENVIRON, "RUNTIME_DIRECTORY": str(tmp_path)})
    kept: list[float | None] = []

    def look() -> None:
        assert bed.service.imu is not None
        saved = read_state(tmp_path / "imu.state")
        kept.append(unpack_pipeline(saved.pipeline, like=bed.service.imu.pipeline.state()).yaw_zero.zero_rad)

    def await_it() -> None:
        # The clock of the service stands meanwhile; only the thread that writes the file goes on.
        end_s = monotonic() + BOUND_S
        while kept[-1] is None and monotonic() < end_s:
            sleep(0.005)
            look()

    bed.clock.at(11.8, lambda: eventually((tmp_path / "imu.state").exists))
    bed.clock.at(11.9, look)
    bed.clock.at(12.0, lambda: zero_of(bed).do("now", {}))
    bed.clock.at(12.1, await_it)
    bed.run(until_s=12.2)
    assert kept[0] is None and kept[-1] is not None


def test_a_state_file_that_knows_no_zero_is_refused() -> None:
    state = build_pipeline(PLAIN).state()
    plain = msgspec.msgpack.decode(pack_pipeline(state))
    assert unpack_pipeline(msgspec.msgpack.encode(plain), like=state).yaw_zero == state.yaw_zero
    del plain["yaw_zero"]
    with pytest.raises(NoState, match="does not fit"):
        unpack_pipeline(msgspec.msgpack.encode(plain), like=state)


def test_a_program_that_reads_the_chip_itself_sets_it_too() -> None:
    clock = VirtualClock()
    chip = FakeMpu6050(clock, motion=Turntable(start_s=3.0, turn_deg=90.0))
    with Imu(FakeBus({0x68: chip}, clock=clock), settings=PLAIN, clock=clock) as imu:
        with pytest.raises(NotPossible, match="no attitude yet"):
            imu.zero_yaw()
        *_, last = imu.messages(until_ns=10 * NS_PER_S)
        imu.zero_yaw()
        first = next(iter(imu))
    assert abs(last.yaw_deg - 90.0) < 3.0
    assert first.yaw_deg == pytest.approx(0.0, abs=0.01)
