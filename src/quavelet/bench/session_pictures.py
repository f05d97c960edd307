"""The pictures of a calibration: what each step measured, and what the fit leaves of it."""

from __future__ import annotations

import numpy as np

from quavelet.bench.session_result import Result, every_pose
from quavelet.bench.session_verdict import GOOD_G, forces_g, rates_dps
from quavelet.calibration.model import UNCALIBRATED
from quavelet.calibration.poses import StillPose
from quavelet.calibration.turns import TurnFit
from quavelet.core.blocks import FloatArray
from quavelet.core.units import DEG_PER_RAD, NS_PER_S, STANDARD_GRAVITY_M_S2
from quavelet.drawing.chart import Chart, Curve

AXES = "xyz"
FIELD_POINTS = 400
"""More are one blot on a screen, and most of the page's size."""
SMALL_MG, GOOD_MG = 1.0, 1e3 * GOOD_G
SHOWS_SLOPE_DEGC = 1.0
"""Over less nothing is to be seen of how the bias goes with temperature."""
_ROUND = np.linspace(0.0, 2.0 * np.pi, 121)
Cloud = tuple[str, FloatArray, FloatArray]


def tilts_deg(result: Result) -> FloatArray:
    """How far off each pose (N,) was shown uncalibrated, as an angle."""
    before, after = (
        forces_g(_poses(result), calibration) for calibration in (UNCALIBRATED, result.record.calibration())
    )
    cosine = (before * after).sum(axis=1) / np.linalg.norm(before, axis=1) / np.linalg.norm(after, axis=1)
    angle: FloatArray = DEG_PER_RAD * np.arccos(np.clip(cosine, -1.0, 1.0))
    return angle


def accelerometer(result: Result) -> tuple[Chart, ...]:
    """Gravity's strength in each pose before and after, and what is left of it on the sphere."""
    fit = result.accel
    assert fit is not None, "drawn only where it is"
    poses = _poses(result)
    up = forces_g(poses, result.record.calibration())
    before = 1e3 * (np.linalg.norm(forces_g(poses, UNCALIBRATED), axis=1) - 1.0)
    after = 1e3 * (np.linalg.norm(up, axis=1) - 1.0)
    number = np.arange(1.0, len(poses) + 1.0)
    fitted = len(poses) - len(result.evidence.check)
    kind = np.where(number > fitted, 2, 1)
    kind[list(fit.used)] = 0
    kinds = [(label, kind == k) for k, label in enumerate(("fitted", "thrown out", "held out"))]
    return (
        _points("accel-before", "Strength of gravity before", ("pose", "off from 1 g, mg"), [("", number, before)]),
        _points(
            "accel-after",
            "Strength of gravity, calibrated",
            ("pose", "off from 1 g, mg"),
            [(label, number[rows], after[rows]) for label, rows in kinds],
            note=f"Held out: by these poses, which the fit did not see, it is judged; {GOOD_MG:g} mg is good enough.",
        ),
        *_spheres(up, np.abs(after)),
    )


def _spheres(up: FloatArray, left_mg: FloatArray) -> tuple[Chart, ...]:
    sizes = (
        (f"within {SMALL_MG:g} mg", left_mg <= SMALL_MG),
        (f"within {GOOD_MG:g} mg", (left_mg > SMALL_MG) & (left_mg <= GOOD_MG)),
        ("more", left_mg > GOOD_MG),
    )
    charts = []
    for name, half, here in (("up", "Z pointing up", up[:, 2] >= 0.0), ("down", "Z pointing down", up[:, 2] < 0.0)):
        circle = Curve("", np.cos(_ROUND), np.sin(_ROUND), dashed=True)
        clouds = tuple(Curve(label, up[size & here, 0], up[size & here, 1]) for label, size in sizes if size.any())
        charts.append(
            Chart(
                f"accel-sphere-{name}",
                f"What is left on the sphere: {half}",
                "gravity along the board's x, g",
                "along its y, g",
                (circle, *clouds),
                kind="points",
                equal=True,
                note="Each point is a still pose, seen along Z; where there is none no such attitude was tried.",
            )
        )
    return tuple(charts)


def bias(result: Result) -> tuple[Chart, ...]:
    """The gyroscope's bias over temperature, and what is left of it over the session."""
    fit, poses = result.bias, every_pose(result.evidence)
    assert fit is not None, "drawn only where it is"
    temps = np.array([pose.temp_degc for pose in poses])
    # What force adds is taken off, so that the points of all attitudes lie on one curve.
    forces = forces_g(poses, result.record.calibration()) * STANDARD_GRAVITY_M_S2
    rates = np.array([pose.gyro_rad_s for pose in poses]) - forces @ np.array(fit.per_force).T
    grid = np.linspace(fit.lowest_degc, fit.highest_degc, 60)
    fitted = fit.curve().at(grid)
    over_temperature = [
        Chart(
            f"bias-{axis}",
            f"Bias of {axis} over temperature",
            "temperature of the chip, degC",
            "deg/s",
            (
                Curve("measured", temps, DEG_PER_RAD * rates[:, k]),
                Curve("fitted", grid, DEG_PER_RAD * fitted[:, k], dotted=True),
            ),
            kind="points",
        )
        for k, axis in enumerate(AXES)
        if fit.highest_degc - fit.lowest_degc >= SHOWS_SLOPE_DEGC
    ]
    begin_ns = np.array([pose.begin_ns for pose in poses])
    minutes = (begin_ns - begin_ns.min()) / NS_PER_S / 60.0
    left = rates_dps(poses, result.record.calibration())
    return (
        *over_temperature,
        _points("temperature", "Temperature of the chip", ("time, min", "degC"), [("", minutes, temps)]),
        _points(
            "bias-left",
            "Rate at rest that the calibration leaves",
            ("time, min", "deg/s"),
            [(axis, minutes, left[:, k]) for k, axis in enumerate(AXES)],
        ),
    )


def turns(fit: TurnFit) -> tuple[Chart, ...]:
    """What is left of each turn."""
    number = np.arange(1.0, len(fit.residual_deg) + 1.0)
    labels = ("tilt, one way", "tilt, across", "turned angle")
    clouds = [(label, number, fit.residual_deg[:, k]) for k, label in enumerate(labels)]
    chart = _points(
        "turns",
        "Turns: integrated rate less what it should be",
        ("turn", "deg"),
        clouds,
        note="The turned angle is known only of the whole turns, which come last: how exactly the board came back to "
        "its edge is in it.",
    )
    return (chart,)


def field(result: Result) -> tuple[Chart, ...]:
    """The magnetic field before and after, seen along each axis."""
    fit = result.field
    assert fit is not None, "drawn only where it is"
    measured = np.array(result.evidence.field_ut)
    measured = measured[:: -(-len(measured) // FIELD_POINTS)]
    true = fit.calibration.corrected_ut(measured)
    x, y = fit.field_ut * np.cos(_ROUND), fit.field_ut * np.sin(_ROUND)
    return tuple(
        Chart(
            f"field-{a}{b}",
            f"Magnetic field, {a} and {b}",
            f"{a}, uT",
            f"{b}, uT",
            (
                Curve("strength of the field", x, y, dashed=True),
                Curve("measured", measured[:, i], measured[:, j]),
                Curve("calibrated", true[:, i], true[:, j]),
            ),
            kind="points",
            equal=True,
        )
        for (i, a), (j, b) in (((0, "x"), (1, "y")), ((0, "x"), (2, "z")), ((1, "y"), (2, "z")))
    )


def _poses(result: Result) -> list[StillPose]:
    """Those that the accelerometer was fitted to, in the fit's order, then those held out."""
    evidence = result.evidence
    return [*evidence.placed, *evidence.poses, *evidence.check]


def _points(name: str, title: str, labels: tuple[str, str], clouds: list[Cloud], *, note: str = "") -> Chart:
    curves = tuple(Curve(label, x, y) for label, x, y in clouds if len(x))
    return Chart(name, title, *labels, curves, kind="points", note=note)
