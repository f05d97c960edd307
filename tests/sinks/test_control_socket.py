"""The local socket: whoever asks well is answered, whoever does not is told so, and nobody holds it up."""

import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from network_rig import BOUND_S, ReadingEnd, Rig, message, network, no_status, reading, until

from quavelet.sinks.asking import AskError, ask_status, decode_status, find_socket, watch
from quavelet.sinks.control import ControlSocket
from quavelet.sinks.message import Message

PATIENCE_S = 0.2


@pytest.fixture
def control(tmp_path: Path) -> Iterator[tuple[Rig, ControlSocket]]:
    with network() as rig:
        part = ControlSocket(tmp_path / "imu.sock", status=no_status, patience_s=PATIENCE_S)
        rig.network.add(part)
        until(lambda: part.stats().state.startswith("listening"))
        yield rig, part


def ask(end: ReadingEnd, question: bytes) -> bytes:
    end.sock.sendall(question)
    return end.line()


def refusal(line: bytes) -> str:
    return msgspec.json.decode(line, type=dict[str, str])["error"]


def answers(path: Path) -> bool:
    try:
        return bool(ask_status(path))
    except AskError:
        return False


def test_status_is_one_line_of_json_and_the_end(control: tuple[Rig, ControlSocket]) -> None:
    path = control[1].path
    assert decode_status(path, ask_status(path)) == no_status()
    with reading(path) as end:
        assert msgspec.json.decode(ask(end, b"  status \r\n"))["state"] == "running"
        assert end.is_closed()
    with reading(path) as end:
        end.sock.sendall(b"status")
        end.sock.shutdown(socket.SHUT_WR)
        assert msgspec.json.decode(end.line())["v"] == 1


def test_watch_gives_the_latest_at_once_and_then_each(control: tuple[Rig, ControlSocket]) -> None:
    rig, part = control
    rig.send(0, 8)
    until(lambda: part._latest == message(7))
    with reading(part.path) as end:
        end.sock.sendall(b"watch\n")
        assert end.times(1) == [7]
        rig.send(8, 300)
        assert end.times(292) == list(range(8, 300))


def test_watch_with_a_rate_gives_fewer(control: tuple[Rig, ControlSocket]) -> None:
    rig, part = control
    with reading(part.path) as slow, reading(part.path) as all_of_it:
        slow.sock.sendall(b"watch 10\n")
        all_of_it.sock.sendall(b"watch\n")
        until(lambda: len(part.watchers) == 2)
        ms = 1_000_000
        for k in range(200):
            rig.network.write(message(k * 10 * ms))
        assert slow.times(20) == [k * 100 * ms for k in range(20)]
        assert all_of_it.times(200)[-1] == 1_990 * ms


@pytest.mark.parametrize(
    "question",
    [
        "",
        "stat",
        "status now",
        "watch fast",
        "watch -1",
        "watch 0",
        "watch nan",
        "watch inf",
        "watch 1e9",
        "GET / HTTP/1.1",
    ],
)
def test_anything_else_is_refused_with_what_to_ask(control: tuple[Rig, ControlSocket], question: str) -> None:
    with reading(control[1].path) as end:
        assert "`status` or `watch [HZ]`" in refusal(ask(end, question.encode() + b"\n"))
        assert end.is_closed()


@given(st.binary(max_size=3_000))
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_whatever_bytes_come_there_is_one_line_and_the_end(control: tuple[Rig, ControlSocket], data: bytes) -> None:
    with reading(control[1].path) as end:
        try:
            end.sock.sendall(data)
            end.sock.shutdown(socket.SHUT_WR)
        except (BrokenPipeError, OSError):
            pass  # refused before it had said all
        assert msgspec.json.decode(end.line())
    until(lambda: control[1].stats().readers == 0)


def test_ten_megabytes_without_a_line_are_refused_after_the_first_of_them(control: tuple[Rig, ControlSocket]) -> None:
    with reading(control[1].path) as end:
        with pytest.raises(ConnectionError):
            end.sock.sendall(bytes(10_000_000))
        assert "longer than 1024 bytes" in refusal(end.line())


def test_half_a_line_and_silence_are_refused_in_time(control: tuple[Rig, ControlSocket]) -> None:
    with reading(control[1].path) as half, reading(control[1].path) as silent:
        half.sock.sendall(b"stat")
        for end in (half, silent):
            assert refusal(end.line()).startswith("no question came within 0.2 s")


def test_the_ninth_is_told_that_there_are_eight(control: tuple[Rig, ControlSocket]) -> None:
    rig, part = control
    with ExitStack() as stack:
        for _ in range(8):
            stack.enter_context(reading(part.path)).sock.sendall(b"watch\n")
        until(lambda: len(part.watchers) == 8)
        with pytest.raises(AskError, match="8 others ask already"):
            ask_status(part.path)
    assert part.stats().refused == 1
    # Those who have left make room, and are forgotten with the next message.
    until(lambda: answers(part.path))
    until(lambda: rig.send(0, 1) or part.stats().readers == 0)
    assert part.watchers == {}


def test_eight_who_say_nothing_keep_nobody_out_and_the_oldest_is_told(tmp_path: Path) -> None:
    with network() as rig, ExitStack() as stack:
        part = ControlSocket(tmp_path / "imu.sock", status=no_status, patience_s=3600.0)
        rig.network.add(part)
        until(lambda: part.stats().state.startswith("listening"))
        silent = [stack.enter_context(reading(part.path)) for _ in range(8)]
        until(lambda: part.stats().readers == 8)
        assert decode_status(part.path, ask_status(part.path)) == no_status()
        assert refusal(silent[0].line()).startswith("others ask, and no question came: ask with a line")
        assert ask(silent[1], b"status\n").startswith(b'{"v":1')
        assert part.stats().refused == 0


def test_a_watcher_that_never_reads_loses_messages_and_another_none(control: tuple[Rig, ControlSocket]) -> None:
    rig, part = control
    with reading(part.path) as _stuck, reading(part.path) as good:
        for end in (_stuck, good):
            end.sock.sendall(b"watch\n")
        until(lambda: len(part.watchers) == 2)
        got: list[int] = []
        n = 4_000
        read = threading.Semaphore(200)

        def take() -> None:
            for _ in range(n):
                got.extend(good.times(1))
                read.release()

        thread = threading.Thread(target=take)
        thread.start()
        for k in range(n):
            assert read.acquire(timeout=BOUND_S)
            rig.send(k, k + 1)
        thread.join(BOUND_S)
        assert got == list(range(n))
        until(lambda: part.stats().sent + part.stats().lost == 2 * n)
        assert part.stats().lost > 0


def test_a_mistake_in_the_status_harms_the_question_only(tmp_path: Path) -> None:
    def wrong() -> object:
        raise KeyError("x")

    with network() as rig:
        part = ControlSocket(tmp_path / "imu.sock", status=wrong)  # type: ignore[arg-type]
        rig.network.add(part)
        until(lambda: part.stats().state.startswith("listening"))
        with pytest.raises(AskError, match="ended before it had answered"):
            ask_status(part.path)
        rig.send(0, 1)
        assert msgspec.json.decode(next(watch(part.path)), type=Message).t_ns == 0


def test_the_only_service_is_found_and_of_several_one_must_be_named(tmp_path: Path) -> None:
    system, user = tmp_path / "run", tmp_path / "user"
    environ = {"XDG_RUNTIME_DIR": str(user)}
    (user / "quavelet").mkdir(parents=True)
    system.mkdir()
    with pytest.raises(AskError, match="no service is found"):
        find_socket(None, environ=environ, system=system)
    (system / "imu0.sock").touch()
    assert find_socket(None, environ=environ, system=system) == system / "imu0.sock"
    (user / "quavelet" / "imu1.sock").touch()
    with pytest.raises(AskError, match="several: give one of"):
        find_socket(None, environ=environ, system=system)
    assert find_socket("imu1", environ=environ, system=system).parent == user / "quavelet"
    assert find_socket("./x", environ={}, system=system) == Path("x")
    with pytest.raises(AskError, match="no service imu9 is found"):
        find_socket("imu9", environ=environ, system=system)


def test_what_is_wrong_with_a_socket_is_said(tmp_path: Path) -> None:
    path = tmp_path / "imu.sock"
    with pytest.raises(AskError, match="is not there"):
        ask_status(path)
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(path))
    with pytest.raises(AskError, match="has ended without taking it away"):
        ask_status(path)
    with pytest.raises(AskError, match="is not that of a service"):
        decode_status(path, b"HTTP/1.1 200 OK\n")


def test_who_finds_many_before_him_waits_for_his_turn(tmp_path: Path) -> None:
    path = tmp_path / "imu.sock"
    with socket.socket(socket.AF_UNIX) as service, ExitStack() as stack:
        service.bind(str(path))
        service.listen(0)
        stack.enter_context(reading(path))  # the queue is full
        answer: list[bytes] = []
        asking = threading.Thread(target=lambda: answer.append(ask_status(path)))
        asking.start()
        for reply in (b"", b"{}\n"):
            connection = stack.enter_context(service.accept()[0])
            connection.sendall(reply)
        asking.join(BOUND_S)
        assert answer == [b"{}\n"]


def test_an_answer_without_end_is_read_to_its_first_line(tmp_path: Path) -> None:
    path, done = tmp_path / "imu.sock", threading.Event()

    def talk(service: socket.socket) -> None:
        with service.accept()[0] as connection:
            try:
                while not done.is_set():
                    connection.sendall(b"{}\n" * 1000)
            except OSError:
                done.set()

    with socket.socket(socket.AF_UNIX) as service:
        service.bind(str(path))
        service.listen(1)
        talking = threading.Thread(target=talk, args=(service,))
        talking.start()
        assert ask_status(path) == b"{}\n"
        talking.join(BOUND_S)
        assert not talking.is_alive()


def test_a_service_that_has_its_socket_but_does_not_listen_yet_is_waited_for(tmp_path: Path) -> None:
    path = tmp_path / "imu.sock"
    answer = msgspec.json.encode(no_status()) + b"\n"
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as sock:
        sock.bind(str(path))

        def serve() -> None:
            sock.listen()
            with sock.accept()[0] as asker:
                asker.recv(100)
                asker.sendall(answer)

        beginning = threading.Timer(0.05, serve)
        beginning.start()
        assert ask_status(path) == answer
        beginning.join()
