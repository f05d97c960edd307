"""The faults that a viewer injects: what is told of each is what happened, measured by the real service."""

from __future__ import annotations

import threading
import time
from contextlib import ExitStack

import msgspec
import pytest
from fault_bed import FaultBed
from matrix import cell

from hw_fakes import Still, open_fake
from hw_fakes.faults.catalogue import CATALOGUE
from hw_fakes.faults.plan import parse
from quavelet.core.clock import MonotonicClock
from quavelet.core.errors import SettingsError
from quavelet.core.units import NS_PER_S
from quavelet.service.service import Service
from quavelet.settings import BusSettings, Settings
from quavelet.web.fault_case import FaultTold
from quavelet.web.faults import Faults

UNNOTICED = "low-bit"


@pytest.fixture(scope="module")
def told() -> dict[str, FaultTold]:
    """Of one run through the whole catalogue."""
    found = FaultBed().inject(*(fault.name for fault in CATALOGUE))
    return {one.name: one for one in found}


@pytest.mark.parametrize("fault", CATALOGUE, ids=lambda fault: fault.name)
def test_the_figures_of_a_fault_are_not_those_of_the_driver(told: dict[str, FaultTold], fault):
    known, one = cell(fault.text, "streaming"), told[fault.name]
    assert known.happened and one.over
    assert one.lasted_ms == pytest.approx(1000.0 * (parse(fault.text).for_s or 0.0), abs=35.0)
    assert (one.noticed_ms is None) == (known.detect_ms is None)
    # A drain sooner or later, and the driver looks at one register after the other.
    if known.detect_ms is not None:
        assert one.noticed_ms == pytest.approx(known.detect_ms, abs=60.0)
    assert one.data_ms == pytest.approx(known.recover_ms, abs=60.0)


@pytest.mark.parametrize("fault", CATALOGUE, ids=lambda fault: fault.name)
def test_a_fault_that_nothing_told_of_is_said_to_be_noticed(told: dict[str, FaultTold], fault):
    one = told[fault.name]
    if fault.name == UNNOTICED:
        assert one.noticed_ms is None and one.recovered_ms is None and one.how == ()
        assert one.says.startswith("Not noticed. The tilt was ")
    else:
        assert one.how and one.noticed_ms >= 0.0
        assert one.recovered_ms >= one.data_ms
        assert one.says.startswith("Noticed after ")


def test_the_signs_of_a_fault_are_those_of_another(told: dict[str, FaultTold]):
    signs = {
        "unplugged": {"bus_errors", "gap", "gaps"},
        "brown-out": {"registers_upset", "chip_restarts", "chip_upset"},
        "overflow": {"fifo_overflows", "overflow"},
        "slip": {"fifo_misaligned", "misaligned"},
        "disturbed": {"bus_errors"},
        "high-bit": {"spikes"},
        "frozen": {"stuck"},
        "temperature": {"frames_implausible", "implausible"},
        "range": {"registers_upset", "chip_upset"},
    }
    for name, some in signs.items():
        assert some <= set(told[name].how), name
    assert "fifo_overflows" not in told["slip"].how
    assert "bus_errors" not in told["brown-out"].how


def test_the_tilt_goes_wrong_without_a_flag_or_is_not_measured(told: dict[str, FaultTold]):
    for one in told.values():
        # Nothing in the samples tells of another range until the driver looks at that register.
        assert one.worst_deg < (5.0 if one.name == "range" else 1.0), one.name
    assert told["frozen"].flagged_deg > 5.0  # the board turned meanwhile, and each message said that it is stuck


def test_what_is_told_is_no_json(told: dict[str, FaultTold]):
    decoded = msgspec.json.decode(msgspec.json.encode(told["frozen"]))
    assert decoded["name"] == "frozen" and decoded["over"] is True


def test_a_second_fault_before_the_first_is_over_is_taken_for_it():
    bed = FaultBed(Still(), at_s=1.5)
    refused: list[str] = []

    def ask() -> None:
        state = bed.ability.state()
        if state.lasting and not refused:
            with pytest.raises(SettingsError, match="not over yet") as error:
                bed.ability.do("inject", {"name": "slip"})
            refused.append(str(error.value))

    each_ms = bed.clock.each_ms
    bed.clock.each_ms = lambda: (each_ms(), ask())
    (one,) = bed.inject("disturbed")
    assert refused and one.name == "disturbed" and "misaligned" not in one.how
    assert bed.ability.state().lasting == ()
    assert bed.ability.state().counters["bus_errors"] == 12


@pytest.mark.parametrize(
    ("what", "values"),
    [
        ("inject", {}),
        ("inject", {"name": None}),
        ("inject", {"name": ["slip"]}),
        ("inject", {"name": "nack every=0.001"}),
        ("inject", {"text": "unplugged"}),
        ("clear", {"name": "slip"}),
        ("", {}),
    ],
)
def test_what_a_stranger_sends_reaches_the_bus(what: str, values: dict[str, object]):
    bus = open_fake("still", clock=MonotonicClock())
    ability = Faults(bus=lambda: bus, counters=dict, clock=MonotonicClock())
    with pytest.raises(SettingsError):
        ability.do(what, values)
    assert ability.state().history == ()
    assert not bus.adapter.faults.plan


@pytest.mark.parametrize("bus", [None, object()])
def test_a_bus_that_is_real_or_not_there_yet_offers_faults(bus: object):
    ability = Faults(bus=lambda: bus, counters=dict, clock=MonotonicClock())
    assert ability.about().faults == ()
    with pytest.raises(SettingsError, match="wait for the chip, or take a fake bus"):
        ability.do("inject", {"name": "slip"})
    ability.close()


def test_the_catalogue_is_in_words_of_its_own():
    about = Faults(
        bus=lambda: open_fake("still", clock=MonotonicClock()), counters=dict, clock=MonotonicClock()
    ).about()
    assert [one.name for one in about.faults] == [one.name for one in CATALOGUE]
    assert len({one.title for one in about.faults}) == len(CATALOGUE) >= 10
    for one in about.faults:
        parse(one.text)


def test_in_real_time_a_fault_is_noticed_by_the_thread_that_looks():
    clock, bus = MonotonicClock(), None

    def opened(_name, clock):
        nonlocal bus
        bus = open_fake("still", clock=clock)
        return bus

    class Page:
        def write(self, message):
            ability.see(message)

        def close(self):
            ability.close()

    def console(service: Service, stack: ExitStack) -> None:
        del stack
        service.messages.subscribe("page", Page(), policy=service.policy)

    service = Service(
        Settings(bus=BusSettings(name="fake:still")),
        clock=clock,
        talk=lambda _text: None,
        console=console,
        realtime=False,
        opened=opened,
    )
    ability = Faults(bus=lambda: bus, counters=lambda: service.imu.health.as_dict() if service.imu else {}, clock=clock)
    thread = threading.Thread(target=service.run)
    thread.start()
    until = time.monotonic() + 20.0
    try:
        while service.last is None and time.monotonic() < until:
            time.sleep(0.01)
        time.sleep(0.2)
        asked_ns = clock.now_ns()
        assert ability.do("inject", {"name": "disturbed"}) == "Disturb the next twelve transfers on the wires: done"
        while not (told := ability.state().history[-1]).over and time.monotonic() < until:
            time.sleep(0.01)
    finally:
        service.stop()
        thread.join()
    assert told.over and asked_ns <= told.at_ns <= asked_ns + NS_PER_S
    assert told.noticed_ms is not None and told.noticed_ms <= 1000.0
    assert "bus_errors" in told.how and told.recovered_ms is not None
    assert not any(one.name == "fault" for one in threading.enumerate())
