"""`quavelet calibrate --write-offsets` as it is installed: run afterwards, pulled off in the middle, refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from program import quavelet
from typer.testing import CliRunner

from hw_fakes.wire.bench import BenchBus
from quavelet.calibration.record_file import load_record
from quavelet.cli import calibrate, exits
from quavelet.cli.app import app

WRITE = ("calibrate", "--yes", "--virtual-time", "--write-offsets")


class Loose(BenchBus):
    """The plug comes off at the first word of an offset that is not the factory's."""

    def write(self, address: int, data: bytes) -> None:
        if data[0] == 0x14 and data[1]:
            self.chip.unplug()
        super().write(address, data)


def test_what_was_written_is_in_the_record_and_run_writes_it_again(tmp_path):
    out = tmp_path / "c.toml"
    done = quavelet(*WRITE, "--bus", "fake:bench:7", "--steps", "warm-up,rest", "--out", out, "--json")
    assert done.code == exits.OK, done.err
    told = json.loads(done.out)
    assert [finding["name"] for finding in told["findings"]][-1] == "chip's offsets"
    assert any("Leave the board lying still" in line and "offsets are written" in line for line in done.said)
    record = load_record(out)
    assert record.offsets is not None
    assert told["record"]["offsets"]["gyro"] == list(record.offsets.gyro)
    assert not list(tmp_path.glob("*.session"))
    more = quavelet(*WRITE[:-1], "--bus", "fake:bench:7", "--steps", "faces", "--out", out)
    assert more.code == exits.OK, more.err
    added = load_record(out)
    assert (added.offsets, added.gyro_bias) == (record.offsets, record.gyro_bias), "kept with what they were made with"
    assert added.accelerometer is not None
    settings = tmp_path / "s.toml"
    settings.write_text(f'[calibration]\nfile = "{out}"\n')
    ran = quavelet("run", "--bus", "fake:bench:7", "--virtual-time", "--duration", 4, "--config", settings)
    assert any("with offsets in the chip" in line for line in ran.said)
    last = json.loads(ran.lines[-1])
    assert np.abs(np.degrees(last["gyro_bias_rad_s"])).max() < 0.3, "15 deg/s are in the chip, some 0.1 by temperature"


def test_a_plug_pulled_while_they_are_written_loses_nothing_and_resume_writes_them(tmp_path, monkeypatch):
    out = tmp_path / "c.toml"
    command = [*map(str, WRITE), "--steps", "warm-up,rest", "--out", str(out), "--bus", "fake:bench:7"]
    monkeypatch.setattr(calibrate, "open_bus", lambda name, *, clock: Loose(clock=clock, seed=7, name=name))
    done = CliRunner().invoke(app, command)
    assert done.exit_code == exits.NO_DEVICE, done.output
    assert "chip's offsets      not written: " in done.stdout
    assert "--resume" in done.stderr.splitlines()[-1]
    assert load_record(out).offsets is None
    monkeypatch.undo()
    done = CliRunner().invoke(app, [*command, "--resume"])
    assert done.exit_code == exits.OK, done.output
    assert load_record(out).offsets is not None
    assert [path.name for path in tmp_path.iterdir()] == ["c.toml"]


@pytest.mark.parametrize(
    ("arguments", "code", "reason"),
    [
        (("--from", "x.qrec"), exits.USAGE, "no registers to write to"),
        (("--bus", "fake:bench", "--steps", "turns"), exits.USAGE, "none of these steps shows an offset"),
        (("--bus", "fake:bench", "--config", "SETTINGS"), exits.SETTINGS, "[offsets] of the settings"),
    ],
)
def test_offsets_that_cannot_be_written_are_refused_before_anything_is_measured(tmp_path, arguments, code, reason):
    settings = tmp_path / "s.toml"
    settings.write_text("[offsets]\nwho_am_i = 0x68\naccel_factory = [0, 1, 0]\ngyro_factory = [0, 0, 0]\n"
                        "accel = [2, 1, 0]\ngyro = [1, 2, 3]\n")  # fmt: skip
    given: list[str | Path] = [settings if argument == "SETTINGS" else argument for argument in arguments]
    done = quavelet("calibrate", "--write-offsets", "--out", tmp_path / "c.toml", *given)
    assert (done.code, done.out) == (code, "")
    assert reason in " ".join(done.said)
