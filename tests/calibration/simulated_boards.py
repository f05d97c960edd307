"""A board drawn from the data sheet's limits that is led through a calibration by hand: its samples, and the truth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from hw_fakes.world.drift import Drift
from hw_fakes.world.imperfections import Imperfections, draw
from hw_fakes.world.motion_base import smooth_step
from quavelet.calibration.accelerometer import AccelerometerFit, fit_accelerometer, sphere_points
from quavelet.calibration.gyro_bias import BiasFit, fit_gyro_bias
from quavelet.calibration.poses import PoseCollector, StillPose
from quavelet.calibration.turns import TurnFit, fit_turns, recognised, turn_between
from quavelet.core.blocks import ImuBlock
from quavelet.core.quaternion import from_matrix, from_rotation_vector, multiply, to_matrix

G = 9.80665
RATE_HZ = 100.0
BANDWIDTH_HZ = 42.0
FACES = ("+z", "+x", "+y", "-z", "-x", "-y")
PLACED_DEG = 0.2
EDGE_DEG = 0.3


@dataclass
class Script:
    """Rates and attitudes of a board that is moved from pose to pose, RATE_HZ samples a second."""

    rng: np.random.Generator
    q: np.ndarray
    rates: list[np.ndarray]
    attitudes: list[np.ndarray]

    def rest(self, seconds: float) -> None:
        n = round(seconds * RATE_HZ)
        self.rates.append(np.zeros((n, 3)))
        self.attitudes.append(np.tile(self.q, (n, 1)))

    def turn(self, rotation_rad, seconds: float) -> None:
        """Smoothly about a fixed axis of the body."""
        t = np.arange(1, round(seconds * RATE_HZ) + 1) / RATE_HZ
        end = smooth_step(t / seconds)[0]
        # A sample is the mean rate over its period.
        mean = np.diff(end, prepend=0.0) * RATE_HZ
        self.rates.append(mean[:, None] * rotation_rad)
        turned = multiply(np.tile(self.q, (len(t), 1)), from_rotation_vector(end[:, None] * rotation_rad))
        self.attitudes.append(turned)
        self.q = turned[-1]

    def to(self, q: np.ndarray, seconds: float) -> None:
        left = multiply(self.q[None] * [1, -1, -1, -1], q[None])[0]
        left = left if left[0] >= 0 else -left
        angle = 2 * np.arccos(min(1.0, left[0]))
        self.turn(left[1:] * (angle / max(np.sin(angle / 2), 1e-9)), seconds)
        self.q = q


def face_attitude(face: str, heading_rad: float) -> np.ndarray:
    """Body to world with this axis of the board up."""
    up = np.zeros(3)
    axis = "xyz".index(face[1])
    up[axis] = 1.0 if face[0] == "+" else -1.0
    side = np.zeros(3)
    side[(axis + 1) % 3] = 1.0
    east = np.cos(heading_rad) * side + np.sin(heading_rad) * np.cross(up, side)
    return from_matrix(np.stack([east, np.cross(up, east), up])[None])[0]


def nudged(q: np.ndarray, sigma_deg: float, rng: np.random.Generator) -> np.ndarray:
    """Not quite as it should have been put."""
    return multiply(q[None], from_rotation_vector(np.radians(rng.normal(0.0, sigma_deg, (1, 3)))))[0]


def bench_script(rng: np.random.Generator, *, poses: int, turns: bool = True) -> Script:
    """Six faces, each twice, turns by whole and half circles on three of them, and poses by hand."""
    s = Script(rng, nudged(face_attitude(FACES[0], 0.0), PLACED_DEG, rng), [], [])
    for face in FACES:
        heading = rng.uniform(0, 2 * np.pi)
        for turned in (0.0, np.pi):
            s.to(nudged(face_attitude(face, heading + turned), PLACED_DEG, rng), 2.0)
            s.rest(3.0)
    for axis, face in enumerate(("+x", "+y", "+z") if turns else ()):
        start = face_attitude(face, rng.uniform(0, 2 * np.pi))
        s.to(start, 2.0)
        s.rest(2.5)
        about = np.eye(3)[axis]
        for degrees in (360.0, -360.0, 180.0, -180.0):
            s.turn(np.radians(degrees) * about, 4.0)
            # Back against its edge, more or less: the hand lets go.
            s.turn(np.radians(rng.normal(0.0, EDGE_DEG)) * about, 0.5)
            s.rest(2.5)
            s.q = s.q / np.linalg.norm(s.q)
    for up in sphere_points(poses)[rng.permutation(poses)]:
        up = up + rng.normal(0.0, 0.1, 3)
        up /= np.linalg.norm(up)
        side = np.cross(up, rng.normal(size=3))
        side /= np.linalg.norm(side)
        s.to(from_matrix(np.stack([side, np.cross(up, side), up])[None])[0], 1.5)
        s.rest(2.0)
    return s


def samples_of(board: Imperfections, script: Script, rng: np.random.Generator, *, begin_s: float = 900.0) -> ImuBlock:
    """What the board shows, in SI as an uncalibrated pipeline has it; the chip has been on for `begin_s`."""
    rates, attitudes = np.vstack(script.rates), np.vstack(script.attitudes)
    n = len(rates)
    t_s = begin_s + np.arange(1, n + 1) / RATE_HZ
    force = np.einsum("nji,j->ni", to_matrix(attitudes), [0.0, 0.0, G])
    gyro = board.gyro_shown_rad_s(rates, force if board.feels_force else None) + board.gyro_error_rad_s(t_s)
    accel = board.accel_shown_m_s2(force) + np.array(board.accel_bias_m_s2)
    gyro = gyro + Drift(rng, sd=board.gyro_drift_rad_s, correlation_s=board.drift_correlation_s).at(t_s)
    accel = accel + Drift(rng, sd=board.accel_drift_m_s2, correlation_s=board.drift_correlation_s).at(t_s)
    gyro = gyro + rng.normal(0.0, board.gyro_noise_rad_s_rthz * np.sqrt(BANDWIDTH_HZ), (n, 3))
    accel = accel + rng.normal(0.0, board.accel_noise_m_s2_rthz * np.sqrt(BANDWIDTH_HZ), (n, 3))
    lsb = np.radians(1 / 65.5), G / 8192
    return ImuBlock(
        t_ns=np.round(t_s * 1e9).astype(np.int64),
        period_s=np.full(n, 1 / RATE_HZ),
        gap_ns=np.zeros(n, dtype=np.int64),
        flags=np.zeros(n, dtype=np.uint32),
        gyro_rad_s=np.round(gyro / lsb[0]) * lsb[0],
        accel_m_s2=np.round(accel / lsb[1]) * lsb[1],
        temp_degc=board.temperature_degc(t_s) + rng.normal(0.0, board.temp_noise_degc, n),
        gyro_bias_rad_s=np.zeros((n, 3)),
        still=np.zeros(n, dtype=np.bool_),
    )


@dataclass
class Calibrated:
    """The fits of one session, and the board's truth."""

    board: Imperfections
    poses: list[StillPose]
    placed: int
    accel: AccelerometerFit
    bias: BiasFit
    turns: TurnFit


def calibrated_board(seed: int, *, poses: int = 24) -> Calibrated:
    """A board from the data sheet's limits, calibrated on the bench from its samples alone."""
    rng, board = np.random.default_rng([6, seed]), draw(seed)
    block = samples_of(board, bench_script(rng, poses=poses), rng)
    return calibrated(board, block)


def calibrated(board: Imperfections, block: ImuBlock, *, placed: int = 12) -> Calibrated:
    """The session's mathematics, in its order; the first `placed` poses are faces."""
    collector = PoseCollector()
    found = [*collector.process(block), *collector.finish()]
    accel = fit_accelerometer(found[placed:], placed=found[:placed])
    found, block = [accel.pose(pose) for pose in found], accel.block(block)
    bias = fit_gyro_bias(found)
    rows = bias.rows(block)
    turns = []
    for k, (before, after) in enumerate(pairwise(found)):
        turn = turn_between(block, before, after, bias_rad_s=rows)
        about = recognised(turn)
        # Only where the person was told to turn it so: by chance a heading changes by half a circle, too.
        told = placed <= k < placed + 15 and about is not None and abs(turn.before_up[about[0]]) > 0.99
        turns.append(replace(turn, axis=about[0], angle_rad=about[1]) if told else turn)
    fit = fit_turns(turns, bias_sigma_rad_s=np.radians(0.01), accelerometer=accel)
    return Calibrated(board, found, placed, accel, bias, fit)
