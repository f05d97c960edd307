"""Every data-ready line passes the contract, and what can go wrong with a GPIO says what to do."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import pytest
from gpio_lines import CONFIG, LABEL, StandIn, simulated_chip

from hw_fakes import FakeDataReady, FakeMpu6050
from quavelet.bus.data_ready import open_data_ready
from quavelet.bus.protocol import DataReady
from quavelet.core.clock import Clock, MonotonicClock, VirtualClock
from quavelet.core.errors import BusBusy, BusError, BusPermission, DeviceMissing, SettingsError
from quavelet.core.units import NS_PER_MS

SMPLRT_DIV, CONFIG_DLPF, INT_ENABLE, PWR_MGMT_1 = 0x19, 0x1A, 0x38, 0x6B
QUEUE = 1024


class DataReadyContract:
    """What every line must do; a subclass gives `line`, its `clock`, and `pulse`, which lets n pulses come."""

    NAME = ""

    def test_its_name_is_what_it_was_opened_by(self, line: DataReady) -> None:
        assert line.name == self.NAME

    def test_each_pulse_is_one_edge_with_its_time(
        self, line: DataReady, clock: Clock, pulse: Callable[[int], None]
    ) -> None:
        before_ns = clock.now_ns()
        pulse(5)
        edges = line.wait(1.0)
        times = [edge.t_ns for edge in edges]
        assert [edge.seq for edge in edges] == [1, 2, 3, 4, 5]
        assert times == sorted(set(times))
        assert before_ns <= times[0]
        assert times[-1] <= clock.now_ns()

    def test_an_edge_is_told_once_and_the_numbers_go_on(self, line: DataReady, pulse: Callable[[int], None]) -> None:
        pulse(2)
        first = line.wait(1.0)
        assert line.wait(0.0) == []
        pulse(3)
        assert [edge.seq for edge in first + line.wait(1.0)] == [1, 2, 3, 4, 5]

    def test_without_a_pulse_it_waits_its_time_and_no_more_is_made_of_it(self, line: DataReady, clock: Clock) -> None:
        before_ns = clock.now_ns()
        assert line.wait(0.02) == []
        assert clock.now_ns() - before_ns >= 20 * NS_PER_MS

    def test_of_more_than_the_queue_the_newest_are_kept_and_the_numbers_show_the_loss(
        self, line: DataReady, pulse: Callable[[int], None]
    ) -> None:
        pulse(QUEUE + 76)
        assert [edge.seq for edge in line.wait(1.0)] == list(range(77, QUEUE + 77))

    def test_a_time_below_0_is_a_mistake_of_the_caller(self, line: DataReady) -> None:
        with pytest.raises(ValueError, match="give 0 or more"):
            line.wait(-0.1)

    def test_a_closed_line_refuses_and_may_be_closed_twice(self, line: DataReady) -> None:
        with line:
            pass
        line.close()
        with pytest.raises(BusError, match="closed: open it again") as caught:
            line.wait(0.0)
        assert caught.value.errno == errno.EBADF


class TestFake(DataReadyContract):
    NAME = "fake:int"
    PERIOD_NS = NS_PER_MS

    @pytest.fixture
    def clock(self) -> Clock:
        return VirtualClock()

    @pytest.fixture
    def chip(self, clock: VirtualClock) -> FakeMpu6050:
        chip = FakeMpu6050(clock)
        clock.advance_ns(100 * NS_PER_MS)
        for register, byte in ((PWR_MGMT_1, 0x01), (CONFIG_DLPF, 0x03), (SMPLRT_DIV, 0x00)):
            chip.write(bytes([register, byte]))
            chip.stop()
        return chip

    @pytest.fixture
    def line(self, chip: FakeMpu6050, clock: Clock) -> FakeDataReady:
        return FakeDataReady(chip, clock=clock)

    @pytest.fixture
    def pulse(self, chip: FakeMpu6050, clock: VirtualClock) -> Callable[[int], None]:
        def pulses(n: int) -> None:
            run = chip.run
            assert run is not None
            chip.write(bytes([INT_ENABLE, 0x01]))
            chip.stop()
            last = run.samples_by(clock.now_ns()) + n
            while run.samples_by(clock.now_ns()) < last:
                clock.advance_ns(NS_PER_MS // 20)
            chip.write(bytes([INT_ENABLE, 0x00]))
            chip.stop()

        return pulses

    def test_who_waits_is_woken_by_the_next_sample(self, chip: FakeMpu6050, line: DataReady, clock: Clock) -> None:
        chip.write(bytes([INT_ENABLE, 0x01]))
        chip.stop()
        run = chip.run
        assert run is not None
        (edge,) = line.wait(1.0)
        taken = run.samples_by(clock.now_ns())
        assert edge.t_ns == pytest.approx(run.start_ns + taken * run.period_ns, abs=1)
        assert clock.now_ns() - edge.t_ns <= 100_000

    def test_a_line_that_is_off_the_pin_gives_nothing(self, chip: FakeMpu6050, line: DataReady) -> None:
        chip.write(bytes([INT_ENABLE, 0x01]))
        chip.stop()
        chip.int_connected = False
        assert line.wait(0.05) == []


class TestGpiod(DataReadyContract):
    """What is asked of gpiod, on a stand-in for it."""

    NAME = "pinctrl-rp1:GPIO3"

    @pytest.fixture
    def clock(self, stand_in: StandIn) -> Clock:
        return stand_in.clock

    @pytest.fixture
    def line(self, stand_in: StandIn) -> Iterator[DataReady]:
        with open_data_ready(self.NAME) as line:
            yield line
        assert not stand_in.requests
        assert not stand_in.open

    @pytest.fixture
    def pulse(self, stand_in: StandIn) -> Callable[[int], None]:
        def pulses(n: int) -> None:
            for _ in range(n):
                stand_in.clock.advance_ns(1)
                stand_in.pulse(stand_in.clock.now_ns())

        return pulses

    def test_a_gpio_that_is_unplugged_is_missing(self, line: DataReady, stand_in: StandIn) -> None:
        stand_in.fail = errno.ENODEV
        with pytest.raises(DeviceMissing, match="plug it in again"):
            line.wait(0.0)


@pytest.mark.skipif(
    not (CONFIG.is_dir() and os.access(CONFIG, os.W_OK)),
    reason="this kernel has no gpio-sim: `modprobe gpio-sim`, as root, makes GPIO chips to test on",
)
class TestGpiodInTheKernel(DataReadyContract):
    """The same on real lines of the kernel's simulated chip, by the real gpiod."""

    NAME = f"{LABEL}:2"

    @pytest.fixture
    def clock(self) -> Clock:
        return MonotonicClock()

    @pytest.fixture
    def lines(self) -> Iterator[Path]:
        pytest.importorskip("gpiod")
        with simulated_chip() as lines:
            yield lines

    @pytest.fixture
    def line(self, lines: Path) -> Iterator[DataReady]:
        assert lines.is_dir()
        with open_data_ready(self.NAME) as line:
            yield line

    @pytest.fixture
    def pulse(self, lines: Path) -> Callable[[int], None]:
        def pulses(n: int) -> None:
            for _ in range(n):
                for level in ("pull-up", "pull-down"):
                    (lines / "sim_gpio2" / "pull").write_text(level)

        return pulses

    def test_a_line_can_be_had_once(self, line: DataReady) -> None:
        with pytest.raises(BusBusy, match="in use by quavelet"):
            open_data_ready(line.name)

    def test_a_line_the_chip_does_not_have_is_missing(self, lines: Path) -> None:
        assert lines.is_dir()
        with pytest.raises(DeviceMissing, match="0 to 3"):
            open_data_ready(f"{LABEL}:4")


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch) -> StandIn:
    stand_in = StandIn()
    stand_in.chips = {
        "/dev/gpiochip0": ("gpio-brcmstb@107d508500", ["-", "-"]),
        "/dev/gpiochip4": ("pinctrl-rp1", [f"GPIO{n}" for n in range(28)]),
    }
    monkeypatch.setitem(sys.modules, "gpiod", stand_in.module())
    monkeypatch.setattr(Path, "glob", lambda _folder, _pattern: [Path(path) for path in stand_in.chips])
    return stand_in


@pytest.mark.parametrize("name", ["pinctrl-rp1:17", "pinctrl-rp1:GPIO17"])
def test_a_line_is_had_by_number_or_by_name(name: str, stand_in: StandIn) -> None:
    with open_data_ready(name):
        assert len(stand_in.requests) == 1


@pytest.mark.parametrize(
    ("name", "kind", "words"),
    [
        ("17", SettingsError, "write LABEL:LINE"),
        ("pinctrl-rp1:", SettingsError, "write LABEL:LINE"),
        (":17", SettingsError, "write LABEL:LINE"),
        ("pinctrl-bcm2711:17", DeviceMissing, "there are gpio-brcmstb@107d508500, pinctrl-rp1"),
        ("pinctrl-rp1:28", DeviceMissing, "its number (0 to 27)"),
        ("pinctrl-rp1:INT", DeviceMissing, "has no line 'INT'"),
        ("pinctrl-rp1:18", BusBusy, "in use by w1: stop"),
    ],
)
def test_a_line_that_cannot_be_had_says_why(name: str, kind: type[Exception], words: str, stand_in: StandIn) -> None:
    stand_in.busy["pinctrl-rp1", 18] = "w1"
    with pytest.raises(kind) as caught:
        open_data_ready(name)
    assert words in str(caught.value)
    assert not stand_in.open, "a chip was left open"


def test_a_chip_that_may_not_be_opened_is_a_matter_of_the_group(stand_in: StandIn) -> None:
    stand_in.chips["/dev/gpiochip4"] = errno.EACCES
    with pytest.raises(BusPermission, match="group gpio"):
        open_data_ready("pinctrl-rp1:17")


def test_a_chip_that_may_not_be_opened_does_not_matter_where_it_is_another(stand_in: StandIn) -> None:
    stand_in.chips["/dev/gpiochip0"] = errno.EACCES
    open_data_ready("pinctrl-rp1:17").close()


def test_a_machine_without_gpio_says_so(stand_in: StandIn) -> None:
    stand_in.chips = {}
    with pytest.raises(DeviceMissing, match="this machine has none"):
        open_data_ready("pinctrl-rp1:17")


@pytest.mark.parametrize("module", [None, ModuleType("gpiod")], ids=["not installed", "Debian 12's 1.6"])
def test_without_the_library_the_extra_is_named(module: ModuleType | None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gpiod", module)
    with pytest.raises(SettingsError, match=r"pip install 'quavelet\[gpio\]'"):
        open_data_ready("pinctrl-rp1:17")


def test_the_real_library_has_all_that_is_asked_of_it() -> None:
    gpiod = pytest.importorskip("gpiod")
    gpiod.LineSettings(
        direction=gpiod.line.Direction.INPUT,
        edge_detection=gpiod.line.Edge.RISING,
        event_clock=gpiod.line.Clock.MONOTONIC,
    )
    assert callable(gpiod.request_lines)
    with pytest.raises(DeviceMissing, match="gpiodetect"):
        open_data_ready("no-such-chip:17")
