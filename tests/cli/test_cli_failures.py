"""Every failure on purpose: its exit code, and one sentence on stderr that says what to do."""

import subprocess
from pathlib import Path

import pytest
from program import PROGRAM, Done, quavelet

from quavelet.cli import exits
from quavelet.recording.format import MAGIC

FAKE = ("--bus", "fake:still", "--virtual-time", "--duration", "1")


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("--bus", "linux:99"), exits.NO_DEVICE, "there is no bus /dev/i2c-99"),
        (("--bus", "linux:one"), exits.SETTINGS, "write linux:N"),
        (("--bus", "linux"), exits.SETTINGS, "'linux' is not a bus"),
        (("--bus", ""), exits.SETTINGS, "'' is not a bus"),
        (("--bus", "serial:1"), exits.SETTINGS, "'serial:1' is not a bus"),
        (("--bus", "fake:none"), exits.SETTINGS, "take one of fake:still"),
        ((*FAKE, "--address", "0x69"), exits.NO_DEVICE, "no answer from address 0x69 on fake:still: check power"),
        ((*FAKE, "--address", "0x100"), exits.SETTINGS, "command line: bus: address = 256 is not"),
        ((*FAKE, "--address", "sixty"), exits.USAGE, "'sixty' is not an address"),
        ((*FAKE, "--record", "/dev/full"), exits.FAILED, "/dev/full exists"),
        ((*FAKE, "--record", "/proc/no/such.qrec"), exits.FAILED, "make its folder first"),
        ((*FAKE, "--record", "."), exits.FAILED, ""),
        ((*FAKE, "--accept-id", "0xff"), exits.SETTINGS, "command line: bus: accept_id = 255 is no WHO_AM_I"),
        ((*FAKE, "--accept-id", "mine"), exits.USAGE, "'mine' is not a WHO_AM_I: write it as 0x7d"),
        (("--bus", "linux:1", "--virtual-time"), exits.SETTINGS, "--virtual-time needs a fake bus"),
        (("--duration", "0"), exits.USAGE, "--duration"),
        (("--duration", "nan"), exits.USAGE, "--duration"),
        (("--duration", "-1"), exits.USAGE, "--duration"),
        (("--frequency", "5"), exits.USAGE, "--frequency"),
        (("--bus",), exits.USAGE, "--bus"),
        (("surplus",), exits.USAGE, "surplus"),
    ],
)
def test_a_wrong_option_is_one_sentence(arguments: tuple[str, ...], code: int, words: str) -> None:
    done = quavelet("run", *arguments)
    (sentence,) = done.said
    assert done.code == code, sentence
    assert words in sentence
    assert done.out == ""


@pytest.mark.parametrize(
    ("toml", "words"),
    [
        ("[bus]\nint_line = '17'", "bus: int_line = '17' is no line: write LABEL:LINE"),
        ("[chip]\nsample_rate_hz = 300", "chip: sample_rate_hz = 300 cannot be made"),
        ("[chip]\nsample_rate_hz = nan", "chip.sample_rate_hz = nan is not a finite number"),
        ("[loop]\nrate_hz = 1e999", "loop.rate_hz = inf is not a finite number"),
        ("[start]\ngyro_bias_dps = [0.0, nan, 0.0]", "start.gyro_bias_dps"),
        ("[start]\ngyro_bias_dps = [0.0, 0.0]", "three numbers"),
        ("[filter]\nkp = -1.0", "filter: kp = -1.0"),
        ("[loop]\nrate_hz = 2", "loop.rate_hz = 2 is too slow"),
        ("[chip]\ndlpf = '3'", "chip.dlpf: Expected `int`, got `str`"),
        ("[chip]\ndlpf = true", "chip.dlpf: Expected `int`, got `bool`"),
        ("[filter]\nmethod = 'euler'", "filter.method"),
        ("[bus]\naddress = 300", "bus: address = 300"),
        (
            "[chip]\nsample_rate = 200",
            "unknown key chip.sample_rate: did you mean sample_rate_hz? [chip] has gyro_range_dps",
        ),
        ("[chips]\ndlpf = 3", "unknown table [chips]: did you mean [chip]? the tables are bus, chip"),
        ("dlpf = 3", "dlpf stands outside a table"),
        ("chip = 3", "chip is a table: write [chip]"),
        ("[chip\n", "is not TOML"),
        ("\x00", "is not TOML"),
        (None, "cannot be read (No such file or directory)"),
    ],
)
def test_a_wrong_setting_is_one_sentence_with_file_and_key(toml: str | None, words: str, tmp_path: Path) -> None:
    path = tmp_path / "imu.toml"
    if toml is not None:
        path.write_text(toml)
    done = quavelet("run", "--config", path)
    (sentence,) = done.said
    assert done.code == exits.SETTINGS, sentence
    assert sentence.startswith(f"quavelet: {path}: ")
    assert words in sentence
    assert done.out == ""


def test_the_file_is_not_blamed_for_a_wrong_option(tmp_path: Path) -> None:
    path = tmp_path / "imu.toml"
    path.write_text("[chip]\ndlpf = 3\n")
    (sentence,) = quavelet("run", "--config", path, "--address", "1").said
    assert sentence.startswith("quavelet: command line: bus: address = 1 ")


@pytest.mark.parametrize(
    ("bus", "words"),
    [
        ("odd:EACCES", "no permission for /dev/i2c-1: add this user to the group i2c"),
        ("odd:EBUSY", "is held by a kernel driver"),
        ("odd:ENODEV", "there is no bus"),
        ("odd:another_chip", "0x19 is an MPU-6886"),
    ],
)
@pytest.mark.parametrize("command", ["run", "doctor"])
def test_a_bus_or_chip_that_does_not_fit_is_one_sentence(
    bus: str, words: str, command: str, with_odd_buses: dict[str, str]
) -> None:
    done = quavelet(command, "--bus", bus, env=with_odd_buses)
    assert done.code == exits.NO_DEVICE, done.err
    if command == "run":
        (sentence,) = done.said
        assert done.out == ""
    else:
        assert done.said == []
        sentence = done.out
    assert words in sentence


def test_a_chip_that_is_unplugged_ends_with_what_was_counted_and_device_lost(
    with_odd_buses: dict[str, str], tmp_path: Path
) -> None:
    path = tmp_path / "dying.qrec"
    done = quavelet("run", "--bus", "odd:dying", "--record", path, env=with_odd_buses)
    assert done.code == exits.DEVICE_LOST
    assert "the chip at 0x68 on odd:dying has given nothing for 10 s" in done.said[-1]
    assert any("samples from odd:dying" in line for line in done.said)
    assert any(" x a transfer failed (bus_errors)" in line for line in done.said)
    again = quavelet("replay", path)
    assert (again.code, len(again.lines)) == (exits.OK, len(done.lines))


def test_a_start_in_vain_leaves_no_recording_that_the_next_try_is_refused_for(tmp_path: Path) -> None:
    path = tmp_path / "new.qrec"
    assert quavelet("run", *FAKE, "--address", "0x69", "--record", path).code == exits.NO_DEVICE
    assert not path.exists()
    assert quavelet("run", *FAKE, "--record", path).code == exits.OK
    before = path.read_bytes()
    done = quavelet("run", *FAKE, "--record", path)
    assert done.code == exits.FAILED
    assert done.said[0].startswith(f"quavelet: {path} exists")
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "there is no recording"),
        (b"", "is empty"),
        (b"some text\n", "is not a recording"),
        (MAGIC[:10], "was cut off within its first line"),
        (MAGIC, "holds no stream"),
        (MAGIC.replace(b"1", b"7"), "is a recording of format 7"),
    ],
)
def test_a_file_that_is_no_recording_is_one_sentence(content: bytes | None, words: str, tmp_path: Path) -> None:
    path = tmp_path / "file.qrec"
    if content is not None:
        path.write_bytes(content)
    done = quavelet("replay", path)
    (sentence,) = done.said
    assert (done.code, done.out) == (exits.FAILED, "")
    assert words in sentence


@pytest.mark.parametrize(
    "arguments", [(), ("--speed", "0"), ("--speed", "nan"), ("--bus", "linux:1")], ids=lambda words: " ".join(words)
)
def test_a_wrong_option_of_replay_is_one_sentence(arguments: tuple[str, ...], recording: Path) -> None:
    done = quavelet("replay", *((recording,) if arguments else ()), *arguments)
    (sentence,) = done.said
    assert (done.code, done.out) == (exits.USAGE, "")
    assert "see `quavelet replay --help`" in sentence


def test_a_truncated_recording_gives_all_it_holds_and_then_fails(recording: Path, tmp_path: Path) -> None:
    whole, cut = quavelet("replay", recording), tmp_path / "cut.qrec"
    cut.write_bytes(recording.read_bytes()[:-5000])
    done = quavelet("replay", cut)
    assert done.code == exits.FAILED
    assert "cut off" in done.said[-1]
    assert 300 < len(done.lines) < len(whole.lines)
    assert done.lines == whole.lines[: len(done.lines)]


def test_a_corrupt_recording_gives_the_rest_flags_the_gap_and_then_fails(recording: Path, tmp_path: Path) -> None:
    content = bytearray(recording.read_bytes())
    content[len(content) // 2] ^= 0xFF
    corrupt = tmp_path / "corrupt.qrec"
    corrupt.write_bytes(content)
    whole, done = quavelet("replay", recording), quavelet("replay", corrupt)
    assert done.code == exits.FAILED
    assert "damaged at byte" in done.said[-1]
    # One drain is gone; the samples of the next one or two come with those after them, for the first ones after a
    # gap wait.
    assert 1 <= len(whole.lines) - len(done.lines) <= 3
    assert any('"gap"' in line for line in done.lines)


@pytest.mark.parametrize(
    "command",
    [("run", *FAKE), ("demo", "--virtual-time", "--duration", "1"), ("config",), ("config", "--schema")]
    + [("doctor", "--bus", "fake:still", "--virtual-time")],
    ids=lambda command: command[0],
)
def test_a_full_disk_behind_stdout_is_said_in_the_last_line(command: tuple[str, ...]) -> None:
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run([PROGRAM, *command], stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    done = Done(ended.returncode, "", ended.stderr)
    assert done.code == exits.FAILED
    assert done.said[-1].startswith("quavelet: standard output failed: ")


def test_no_command_at_all_shows_the_help() -> None:
    done = quavelet()
    assert (done.code, done.out) == (exits.USAGE, "")
    assert "Commands:" in done.err


def test_an_unknown_command_is_one_sentence() -> None:
    done = quavelet("fly")
    (sentence,) = done.said
    assert done.code == exits.USAGE
    assert sentence == "quavelet: No such command 'fly', see `quavelet --help`"
