"""What a person at the bench reads: it fits a small terminal, and says what is, what is asked for and what is wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from quavelet.bench.session import STEPS, Session, View
from quavelet.bench.session_evidence import Chip, Evidence
from quavelet.bench.session_watch import Seen, Watch
from quavelet.calibration.record import ChipIdentity
from quavelet.cli.calibrate_panel import render
from quavelet.core.blocks import RawBlock, Scale
from quavelet.core.instruction import Instruction

SCALE = Scale(
    accel_m_s2_per_lsb=0.0012, gyro_rad_s_per_lsb=2.7e-4, temp_degc_per_lsb=1.0 / 340.0, temp_degc_at_zero=36.53
)
CHIP = Chip(
    identity=ChipIdentity(who_am_i=0x68, name="MPU-6050", bus="linux:1", address=0x68),
    gyro_range_dps=500,
    accel_range_g=4,
    scale=SCALE,
)
WIDE, HIGH = 80, 24


def seen(**changed: object) -> Seen:
    n = 20
    raw = RawBlock(
        t_ns=np.arange(n) * 5_000_000,
        period_s=np.full(n, 0.005),
        gap_ns=np.zeros(n, np.int64),
        flags=np.zeros(n, np.uint32),
        counts=np.tile(np.array([0, 0, 8192, 0, 0, 0, 0], np.int16), (n, 1)),
        scale=SCALE,
    )
    return replace(Watch().seen(raw), **changed)


def view(**changed: object) -> View:
    plain = Session(STEPS, Evidence(chip=CHIP)).view()
    return replace(plain, seen=seen(), needs_s=3.5, **changed)


def shown(one: View) -> list[str]:
    console = Console(width=WIDE, record=True, file=None, quiet=False, force_terminal=False)
    with console.capture() as text:
        console.print(render(one, "linux:1"))
    return text.get().splitlines()


@pytest.mark.parametrize("action", ["rest", "face", "turn", "pose", "warm", "swing"])
def test_all_steps_and_the_longest_words_fit_a_terminal_of_80_by_24(action):
    face = "-y" if action in ("face", "turn") else ""
    asked = Instruction(action=action, face=face, turn_deg=-360.0 if action == "turn" else 0.0)
    notice = "the temperature stands still too early: warm the board more, or cool it in a bag in a fridge"
    lines = shown(view(instruction=asked, notice=notice))
    assert len(lines) < HIGH
    assert max(map(len, lines)) <= WIDE
    assert "…" not in "".join(lines)


@pytest.mark.parametrize(
    ("board", "asked", "words"),
    [
        ({"still_s": 1.24}, Instruction(action="rest"), "1.2 of 3.5 s"),
        ({"still_s": 9.0}, Instruction(action="rest"), "3.5 of 3.5 s"),
        (
            {"still_s": 0.0, "turned_deg": -97.0},
            Instruction(action="turn", face="+z", turn_deg=-360.0),
            "moving, turned by -97° of -360°",
        ),
        (
            {"still_s": 0.0, "turned_deg": -97.0},
            Instruction(action="turn", face="+z", turn_deg=180.0),
            "moving, turned by -97° of 180°",
        ),
        ({"face": "-x"}, Instruction(action="face", face="+y"), "-x  (asked for: +y)"),
        ({"face": None}, Instruction(action="face", face="+y"), "no face  (asked for: +y)"),
    ],
)
def test_the_board_is_told_beside_what_is_asked_for(board, asked, words):
    assert words in "\n".join(shown(replace(view(instruction=asked), seen=seen(**board))))


def test_the_face_that_was_asked_for_is_told_alone():
    told = "\n".join(shown(replace(view(instruction=Instruction(action="face", face="+y")), seen=seen(face="+y"))))
    assert "+y" in told
    assert "asked for" not in told
