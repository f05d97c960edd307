"""Unix and TCP outputs: many readers, each harmed by itself alone, and what is lost is counted."""

import asyncio
import socket
import stat
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from network_rig import BOUND_S, ReadingEnd, Rig, network, reading, tcp_address, until

from quavelet.sinks.output import Output
from quavelet.sinks.transports.readers import KERNEL_BYTES, MOST_WAITING_BYTES

Place = Callable[[Rig], tuple[Output, Path | tuple[str, int]]]


@pytest.fixture
def rig() -> Iterator[Rig]:
    # Both ends are threads of one interpreter: let it be handed over as fast as the loop in real time has it.
    before = sys.getswitchinterval()
    sys.setswitchinterval(0.0001)
    with network() as rig:
        yield rig
    sys.setswitchinterval(before)


@pytest.fixture(params=["unix", "tcp", "tcp IPv6"])
def place(request: pytest.FixtureRequest, tmp_path: Path) -> Place:
    def make(rig: Rig) -> tuple[Output, Path | tuple[str, int]]:
        if request.param == "unix":
            path = tmp_path / "imu.sock"
            return rig.output(f"unix:{path}"), path
        output = rig.output("tcp:127.0.0.1:0" if request.param == "tcp" else "tcp:[::1]:0")
        return output, tcp_address(rig.status(output))

    return make


def join(rig: Rig, output: Output, stack: ExitStack, address: Path | tuple[str, int], n: int) -> list[ReadingEnd]:
    ends = [stack.enter_context(reading(address)) for _ in range(n)]
    until(lambda: rig.status(output).readers == n)
    return ends


def test_seven_readers_get_every_message_while_an_eighth_never_reads(rig: Rig, place: Place) -> None:
    output, address = place(rig)
    got: dict[int, list[int]] = {}
    n, step = 3_000, 100
    with ExitStack() as stack:
        _, *good = join(rig, output, stack, address, 8)
        # One of each, or a fast one's would let a slow one fall behind.
        written = [threading.Semaphore(step) for _ in good]

        def read(k: int, end: ReadingEnd) -> None:
            got[k] = []
            for _ in range(n):
                got[k] += end.times(1)
                written[k].release()

        threads = [threading.Thread(target=read, args=item) for item in enumerate(good)]
        for thread in threads:
            thread.start()
        for k in range(n):
            # Not faster than the good ones read, or each would be a slow one.
            for room in written:
                assert room.acquire(timeout=BOUND_S)
            rig.send(k, k + 1)
        for thread in threads:
            thread.join(BOUND_S)
        until(lambda: rig.status(output).sent + rig.status(output).lost == 8 * n)
        status = rig.status(output)
        assert all(times == list(range(n)) for times in got.values())
        assert (status.readers, status.refused) == (8, 0)
        assert 0 < status.lost < n


def test_a_slow_reader_gets_whole_messages_and_each_that_is_missing_is_counted(rig: Rig, place: Place) -> None:
    output, address = place(rig)
    with ExitStack() as stack:
        (slow,) = join(rig, output, stack, address, 1)
        n = 6_000
        rig.send(0, n)
        until(lambda: rig.status(output).sent + rig.status(output).lost == n)
        status = rig.status(output)
        assert status.lost > 0
        times = slow.times(status.sent)
        assert times == sorted(set(times))
        rig.send(n, n + 1)
        assert slow.times(1) == [n]
        assert rig.status(output).lost == status.lost


def test_what_waits_for_a_reader_that_never_reads_is_bounded(rig: Rig, tmp_path: Path) -> None:
    path = tmp_path / "imu.sock"
    output = rig.output(f"unix:{path}")
    with ExitStack() as stack:
        join(rig, output, stack, path, 1)
        rig.send(0, 5_000)
        until(lambda: rig.status(output).sent + rig.status(output).lost == 5_000)
        # The kernel doubles what it is asked for.
        assert rig.status(output).bytes < MOST_WAITING_BYTES + 2 * KERNEL_BYTES + 1_000


def test_who_joins_late_gets_the_latest_at_once(rig: Rig, place: Place) -> None:
    output, address = place(rig)
    rig.send(0, 3)
    with ExitStack() as stack:
        (end,) = join(rig, output, stack, address, 1)
        assert end.times(1) == [2]


def test_a_ninth_reader_is_turned_away_and_counted_until_one_leaves(rig: Rig, place: Place) -> None:
    output, address = place(rig)
    with ExitStack() as stack:
        ends = join(rig, output, stack, address, 8)
        with reading(address) as ninth:
            assert ninth.is_closed()
        assert (rig.status(output).readers, rig.status(output).refused) == (8, 1)
        ends[0].close()
        until(lambda: rig.send(0, 1) or rig.status(output).readers == 7)
        with reading(address) as late:
            assert late.times(1) == [0]


def test_readers_that_have_left_make_room_though_nothing_was_sent_meanwhile(rig: Rig, place: Place) -> None:
    output, address = place(rig)
    rig.send(0, 1)
    with ExitStack() as stack:
        for end in join(rig, output, stack, address, 8):
            end.close()

    def is_let_in() -> bool:
        with reading(address) as late:
            return b'"t_ns":0' in late.line()

    until(is_let_in)
    until(lambda: rig.status(output).sent == 9)


def test_who_shuts_its_writing_side_goes_on_reading(rig: Rig, place: Place) -> None:
    output, address = place(rig)
    with ExitStack() as stack:
        (end,) = join(rig, output, stack, address, 1)
        end.sock.shutdown(socket.SHUT_WR)
        rig.send(0, 100)
        assert end.times(100) == list(range(100))


def test_what_readers_say_is_thrown_away(rig: Rig, place: Place) -> None:
    output, address = place(rig)
    with ExitStack() as stack:
        loud, half, _mute, good = join(rig, output, stack, address, 4)
        half.sock.sendall(b"half a li")
        stop = threading.Event()

        def shout() -> None:
            loud.sock.settimeout(0.05)
            rest = memoryview(bytes(10_000_000))
            while rest and not stop.is_set():
                try:
                    rest = rest[loud.sock.send(rest) :]
                except TimeoutError:
                    continue

        shouting = threading.Thread(target=shout)
        shouting.start()
        rig.send(0, 100)
        assert good.times(100) == list(range(100))
        assert half.times(100) == list(range(100))
        stop.set()
        shouting.join(BOUND_S)
        assert rig.status(output).lost == 0


def open_files() -> int:
    return sum(1 for _ in Path("/proc/self/fd").iterdir())


def test_a_thousand_readers_that_come_and_go_leave_nothing_behind(
    rig: Rig, place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("quavelet.sinks.listener.REST_S", 0.0002)
    output, address = place(rig)
    threads, tasks = threading.active_count(), len(asyncio.all_tasks(rig.network._loop))
    with reading(address) as end:
        rig.send(0, 1)
        end.times(1)
    until(lambda: rig.send(0, 1) or rig.status(output).readers == 0)
    before = open_files()
    for _ in range(1_000):
        with reading(address) as end:
            end.line()
    until(lambda: rig.send(0, 1) or rig.status(output).readers == 0)
    until(lambda: open_files() <= before)
    assert threading.active_count() == threads
    assert len(asyncio.all_tasks(rig.network._loop)) == tasks


def test_only_user_and_group_may_read_a_unix_socket_and_its_file_goes_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "imu.sock"
    with network() as rig:
        rig.output(f"unix:{path}")
        assert stat.S_IMODE(path.stat().st_mode) == 0o660
    assert not path.exists()


def test_the_socket_of_a_dead_program_is_taken_over(tmp_path: Path) -> None:
    path = tmp_path / "imu.sock"
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(path))
    with network() as rig, ExitStack() as stack:
        output = rig.output(f"unix:{path}")
        join(rig, output, stack, path, 1)


def test_a_socket_that_another_program_listens_on_is_left_alone_until_it_ends(tmp_path: Path) -> None:
    path = tmp_path / "imu.sock"
    with network() as first, network() as second:
        mine = first.output(f"unix:{path}")
        inode = path.stat().st_ino
        with pytest.raises(AssertionError):
            second.output(f"unix:{path}")
        assert path.stat().st_ino == inode
        assert f"output.x: another program listens on {path}: stop it" in second.said[0]
        first.network.remove(mine)
        until(lambda: second.said[-1] == "output.x: works again")
        assert len(second.said) == 2


def test_a_file_that_is_no_socket_is_never_removed(tmp_path: Path) -> None:
    path = tmp_path / "imu.sock"
    path.write_text("precious")
    with network() as rig:
        with pytest.raises(AssertionError):
            rig.output(f"unix:{path}")
        assert f"{path} is there and is no socket" in rig.said[0]
    assert path.read_text() == "precious"


def test_a_path_that_cannot_be_is_told_with_what_it_is(rig: Rig, tmp_path: Path) -> None:
    for path, why in (
        (tmp_path / "not here" / "x.sock", "not here: No such file or directory"),
        ("~nobody-of-that-name/x.sock", "~nobody-of-that-name: No such file or directory"),
    ):
        with pytest.raises(AssertionError):
            rig.output(f"unix:{path}")
        assert any(why in said for said in rig.said)


def test_a_home_too_deep_for_a_socket_is_told_with_its_path(
    rig: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = tmp_path / ("x" * 100)
    home.mkdir()
    monkeypatch.setenv("HOME", str(home))
    with pytest.raises(AssertionError):
        rig.output("unix:~/x.sock")
    assert f"'{home}/x.sock' is no path of a socket: give at most" in rig.said[0]


def test_all_of_ipv6_is_all_of_ipv4_too(rig: Rig) -> None:
    output = rig.output("tcp:[::]:0")
    port = tcp_address(rig.status(output))[1]
    rig.send(7, 8)
    for host in ("127.0.0.1", "::1"):
        with reading((host, port)) as end:
            assert end.times(1) == [7]


def test_a_port_that_is_taken_is_told_once(rig: Rig) -> None:
    taken = rig.output("tcp:127.0.0.1:0")
    port = tcp_address(rig.status(taken))[1]
    with pytest.raises(AssertionError):
        rig.output(f"tcp:127.0.0.1:{port}")
    assert "address already in use" in rig.said[0].lower()
