"""`fake:bench`: a board, drawn from within the data sheet, that does what the session at a bench asks for."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from hw_fakes.boards import board
from hw_fakes.chip.mpu6050 import FakeMpu6050
from hw_fakes.chip.registers import ACCEL_TRIM
from hw_fakes.wire.bus import FakeBus
from hw_fakes.world.heated import Heated
from hw_fakes.world.imperfections import draw
from hw_fakes.world.motion_base import FloatArray
from hw_fakes.world.motion_told import UP, ToldMotion
from quavelet.core.clock import Clock
from quavelet.core.instruction import Instruction
from quavelet.core.units import RAD_PER_DEG

ADDRESS = 0x68
BOARD = "gy-87-hmc5883l"
HESITATES_S = 0.5
"""Between being told and beginning."""
MOVES_S = 1.5
TURN_DEG_S = 60.0
PLACED_DEG = 0.1
"""How a hand puts a board down, one sigma about each axis; and back against its edge, after a turn."""
TABLE_DEG = 0.2
"""How the table leans, one sigma each way: a board that is turned half round leans the other way."""
LIES_SO_DEG = 3.0
"""A board that lies so already is not touched."""
WARM_UP_S = 60.0
"""A small board comes to its own temperature faster than the fakes of other scenarios."""
WARMED_DEGC = 25.0
COOLS_S = 120.0
SWINGS = 40
ATTITUDES = 31


class BenchBus(FakeBus):
    """A GY-87 in the hands of somebody obedient; implements `quavelet.bus.protocol.FollowsInstructions`.

    motion     the truth of what the board did
    sensor     the truth of its sensors, drawn within the data sheet's limits by `seed`
    told       the instructions, in order
    """

    def __init__(self, *, clock: Clock, seed: int = 0, name: str = "fake:bench") -> None:
        self.motion = ToldMotion()
        drawn = replace(draw(seed), warm_up_s=WARM_UP_S)
        self.sensor = Heated(**{f.name: getattr(drawn, f.name) for f in fields(drawn)})
        self.told: list[Instruction] = []
        bought = board(BOARD)
        aux = bought.aux_master(clock, self.motion)
        self.chip = FakeMpu6050(
            clock,
            motion=self.motion,
            imperfections=self.sensor,
            seed=seed,
            personality=bought.personality,
            aux=aux,
            accel_trim=_trim(seed),
        )
        self._hand = np.random.default_rng((seed, 50))
        self._attitudes = self._hand.permutation(_all_round(ATTITUDES))
        self._table = UP + np.append(TABLE_DEG * RAD_PER_DEG * self._hand.standard_normal(2), 0.0)
        self._put_down(np.array([0.0, 0.0, 1.0]), -10.0, touched=True)
        super().__init__({ADDRESS: self.chip, **aux.outside()}, clock=clock, name=name)

    def follow(self, instruction: Instruction, /) -> None:
        """Begin to do it now. What is under way is done to its end first."""
        self.told.append(instruction)
        at_s = self.chip.world_time_s(self.clock.now_ns()) + HESITATES_S
        match instruction.action:
            case "face":
                axis, sign = "xyz".index(instruction.face[1]), 1.0 if instruction.face[0] == "+" else -1.0
                self._put_down(sign * np.eye(3)[axis], at_s)
            case "turn":
                angle_deg = instruction.turn_deg + PLACED_DEG * self._hand.standard_normal()
                takes_s = 2.0 + abs(instruction.turn_deg) / TURN_DEG_S
                self.motion.turn(self._table, angle_deg * RAD_PER_DEG, at_s=at_s, takes_s=takes_s)
            case "pose":
                self._put_down(self._attitudes[len(self.told) % len(self._attitudes)], at_s)
            case "warm":
                now_degc = float(self.sensor.temperature_degc(np.array([at_s]))[0])
                self.sensor.goes_to(now_degc + 2.0 * WARMED_DEGC, from_s=at_s, within_s=30.0)
                self.sensor.goes_to(now_degc, from_s=at_s + 30.0, within_s=COOLS_S)
            case "swing":
                for up in _all_round(SWINGS):
                    self.motion.bring_up(up, at_s=at_s, takes_s=1.0)
            case "rest":
                pass
        self.chip.recompute()

    def bump(self, *, by_deg: float = 2.0) -> None:
        """Somebody knocks at the board: it turns by so much, and back, within 0.2 s."""
        at_s = self.chip.world_time_s(self.clock.now_ns())
        axis = self._hand.standard_normal(3)
        for sign in (1.0, -1.0):
            self.motion.turn(axis, sign * by_deg * RAD_PER_DEG, at_s=at_s, takes_s=0.1)
        self.chip.recompute()

    def _put_down(self, up: FloatArray, at_s: float, *, touched: bool = False) -> None:
        lean = PLACED_DEG * RAD_PER_DEG * self._hand.standard_normal(3)
        up = up / np.linalg.norm(up)
        now = self.motion.specific_force_m_s2(np.array([max(at_s, self.motion.free_s)]))[0]
        if touched or now @ up < np.cos(LIES_SO_DEG * RAD_PER_DEG) * np.linalg.norm(now):
            self.motion.bring_up(up + np.cross(lean, up), at_s=at_s, takes_s=MOVES_S, to=self._table)


def _trim(seed: int) -> tuple[int, int, int]:
    """The factory's accelerometer offsets, by which one chip is told from another; their lowest bits tell the revision
    of the silicon, and stay."""
    drawn = np.random.default_rng((seed, 51)).integers(-2500, 2500, 3).tolist()
    x, y, z = (word & ~1 | usual & 1 for word, usual in zip(drawn, ACCEL_TRIM, strict=True))
    return x, y, z


def _all_round(n: int) -> FloatArray:
    """(n, 3) unit vectors all over the sphere, from pole to pole, each near the one before."""
    z = 1.0 - (2.0 * np.arange(n) + 1.0) / n
    across, turn = np.sqrt(1.0 - z * z), 2.0 * np.pi * np.arange(n) / np.sqrt(n)
    return np.column_stack([across * np.cos(turn), across * np.sin(turn), z])
