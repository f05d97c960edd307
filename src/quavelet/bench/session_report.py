"""The page of a calibration: it opens without a network, the verdict first, then a picture of each step."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from quavelet.bench.finding import Finding
from quavelet.bench.session_result import AxisNoise, Result, every_pose
from quavelet.bench.session_verdict import forces_g, rates_dps
from quavelet.calibration.model import UNCALIBRATED
from quavelet.core.blocks import FloatArray
from quavelet.core.units import DEG_PER_RAD, NS_PER_S, STANDARD_GRAVITY_M_S2
from quavelet.drawing.chart import Chart, Curve
from quavelet.drawing.page import Cell, Mark, Section, Table, html_page, write

AXES = "xyz"
Cloud = tuple[str, FloatArray, FloatArray]


def write_report(path: Path, result: Result, findings: list[Finding], *, src: str, saved: str | None) -> None:
    """Write the page. Raises SettingsError without matplotlib, PageError where it cannot be written."""
    chip, made = result.record.chip, result.record.made
    words = (
        f"{chip.name} at 0x{chip.address:02x} on {src}, {made.gyro_range_dps} deg/s and {made.accel_range_g} g, at "
        f"{made.lowest_degc:.1f} to {made.highest_degc:.1f} degC, {made.utc}. "
        + (f"Saved as {saved}." if saved else "Nothing was saved.")
        + (" This is a fake chip: NOT A REAL ONE." if "fake:" in src else ""),
    )
    sections = [_verdict(findings)]
    if result.accel is not None:
        sections.append(_accelerometer(result))
    if result.bias is not None:
        sections.append(_bias(result))
    if result.turns is not None:
        sections.append(_turns(result))
    if result.field is not None:
        sections.append(_field(result))
    if result.noise:
        sections.append(_noise(result.noise))
    page = html_page("quavelet: calibration of a board", words, sections, foot=f"quavelet {made.version}")
    write(path, page.encode())


def _verdict(findings: list[Finding]) -> Section:
    def mark(one: Finding) -> Mark:
        return "bad" if not one.ok else "doubt" if one.advice else "good"

    rows = tuple(
        (Cell(one.name), Cell("good" if one.ok else "not good enough", mark(one)), Cell(one.found), Cell(one.advice))
        for one in findings
    )
    return Section("Verdict", tables=(Table("Before and after", ("part", "verdict", "found", "advice"), rows),))


def _accelerometer(result: Result) -> Section:
    fit, evidence, calibration = result.accel, result.evidence, result.record.calibration()
    assert fit is not None, "shown only where it is"
    fitted, check = [*evidence.placed, *evidence.poses], evidence.check
    number = np.arange(1.0, len(fitted) + len(check) + 1.0)
    before = 1e3 * (np.linalg.norm(forces_g([*fitted, *check], UNCALIBRATED), axis=1) - 1.0)
    up = forces_g([*fitted, *check], calibration)
    after = 1e3 * (np.linalg.norm(up, axis=1) - 1.0)
    n = len(fitted)
    thrown = np.ones(n, dtype=np.bool_)
    thrown[list(fit.used)] = False
    away = np.abs(after)
    kinds = (("below 1 mg", away < 1.0), ("1 to 3 mg", (away >= 1.0) & (away < 3.0)), ("above 3 mg", away >= 3.0))
    azimuth = DEG_PER_RAD * np.arctan2(up[:, 1], up[:, 0])
    height = DEG_PER_RAD * np.arctan2(up[:, 2], np.hypot(up[:, 0], up[:, 1]))
    charts = (
        _points(
            "accel-before", "Strength of gravity, less 1 g: before", ("pose", "mg"), [("all poses", number, before)]
        ),
        _points(
            "accel-after",
            "Strength of gravity, less 1 g: calibrated",
            ("pose", "mg"),
            [
                ("fitted", number[:n][~thrown], after[:n][~thrown]),
                ("thrown out", number[:n][thrown], after[:n][thrown]),
                ("held out", number[n:], after[n:]),
            ],
        ),
        _points(
            "accel-sphere",
            "The residuals on the sphere",
            ("azimuth of up, from the board's x to its y, deg", "its height above the board's x-y plane, deg"),
            [(label, azimuth[rows], height[rows]) for label, rows in kinds],
            note="Each point is a still pose. Empty places are attitudes that were not tried.",
        ),
    )
    rows = tuple(
        (
            Cell(axis),
            Cell(f"{1e3 * fit.offset_m_s2[k] / STANDARD_GRAVITY_M_S2:+.2f} ± {1e3 * fit.sigma[k]:.2f}"),
            Cell(f"{100 * (fit.matrix[k][k] - 1.0):+.3f} ± {100 * fit.sigma[3 + 4 * k]:.3f}"),
        )
        for k, axis in enumerate(AXES)
    )
    head = ("axis", "offset, mg", "scale, % corrected")
    return Section(
        "Accelerometer",
        tables=(Table("What was found", head, rows, numbers=frozenset({1, 2})),),
        charts=charts,
        remarks=tuple(f"The poses do not show {name}: it is left as it was." for name in fit.undetermined),
    )


def _bias(result: Result) -> Section:
    fit, poses = result.bias, every_pose(result.evidence)
    assert fit is not None, "shown only where it is"
    temps = np.array([pose.temp_degc for pose in poses])
    t_s = np.array([pose.begin_ns for pose in poses]) / NS_PER_S
    curve = fit.curve()
    # What force adds is taken off, so that the points of all attitudes lie on one curve.
    forces = forces_g(poses, result.record.calibration()) * STANDARD_GRAVITY_M_S2
    rates = np.array([pose.gyro_rad_s for pose in poses]) - forces @ np.array(fit.per_force).T
    grid = np.linspace(fit.lowest_degc, fit.highest_degc, 60)
    fitted = curve.at(grid)
    charts = [
        Chart(
            f"bias-{axis}",
            f"Bias of {axis} over temperature",
            "temperature of the chip, degC",
            "deg/s",
            (
                Curve("measured", temps, DEG_PER_RAD * rates[:, k]),
                Curve("fitted", grid, DEG_PER_RAD * fitted[:, k], dashed=True),
            ),
            kind="points",
        )
        for k, axis in enumerate(AXES)
    ]
    begins = t_s - t_s.min() if len(t_s) else t_s
    charts.append(_points("temperature", "Temperature in the session", ("time, s", "degC"), [("", begins, temps)]))
    left = rates_dps(poses, result.record.calibration())
    charts.append(
        _points(
            "bias-left",
            "Rate at rest that is left by the calibration",
            ("time, s", "deg/s"),
            [(axis, begins, left[:, k]) for k, axis in enumerate(AXES)],
        )
    )
    return Section("Gyroscope bias", charts=tuple(charts))


def _turns(result: Result) -> Section:
    fit = result.turns
    assert fit is not None, "shown only where it is"
    number = np.arange(1.0, len(fit.residual_deg) + 1.0)
    clouds = [
        (label, number, fit.residual_deg[:, k])
        for k, label in enumerate(("tilt, one way", "tilt, across", "about the vertical"))
    ]
    rows = tuple(
        (
            Cell(axis),
            Cell(f"{100 * (fit.matrix[k][k] - 1.0):+.3f} ± {100 * fit.sigma[4 * k]:.3f}"),
        )
        for k, axis in enumerate(AXES)
    )
    return Section(
        "Gyroscope scale",
        tables=(Table("What was found", ("axis", "scale, % corrected"), rows, numbers=frozenset({1})),),
        charts=(
            _points(
                "turns",
                "What is left of each turn",
                ("turn", "deg"),
                clouds,
                note="About the vertical only for turns whose angle was asked for; those come last.",
            ),
        ),
    )


def _field(result: Result) -> Section:
    fit = result.field
    assert fit is not None, "shown only where it is"
    field = np.array(result.evidence.field_ut)
    field = field[:: max(1, len(field) // 1500)]
    true = fit.calibration.corrected_ut(field)
    charts = [
        _points(
            f"field-{a}{b}",
            f"Magnetic field, {a} and {b}",
            (f"{a}, uT", f"{b}, uT"),
            [("measured", field[:, i], field[:, j]), ("calibrated", true[:, i], true[:, j])],
        )
        for (i, a), (j, b) in (((0, "x"), (1, "y")), ((0, "x"), (2, "z")), ((1, "y"), (2, "z")))
    ]
    words = f"{fit.field_ut:.1f} uT, seen from {100 * fit.coverage:.0f} % of all directions."
    return Section("Magnetometer", words=(words,), charts=tuple(charts))


def _noise(noise: tuple[AxisNoise, ...]) -> Section:
    charts, rows = [], []
    for sheet in dict.fromkeys(one.sheet for one in noise):
        curves = []
        for one in (one for one in noise if one.sheet is sheet):
            tau, deviation = one.curve.tau_s, one.curve.deviation / sheet.unit_si
            curves.append(Curve(one.axis, tau, deviation))
            if one.fit is not None:
                curves.append(Curve("", tau, one.fit.deviation(tau) / sheet.unit_si, dashed=True))
                density, instability = one.fit.density, one.fit.instability
                rows.append(
                    (
                        Cell(f"{sheet.name} {one.axis}"),
                        Cell(f"{density.value / sheet.unit_si:.4g} ± {density.sigma / sheet.unit_si:.2g}"),
                        Cell(f"{sheet.density:g}"),
                        Cell(sheet.unit),
                        Cell(sheet.word(density.value)),
                        Cell(f"{instability.value / sheet.unit_si:.2g}" if instability.seen else "not seen"),
                    )
                )
        charts.append(
            Chart(
                f"allan-{sheet.name}",
                f"Allan deviation of the {sheet.name}",
                "averaging time, s",
                sheet.unit,
                tuple(curves),
                log_x=True,
                log_y=True,
                note="Dashed: what was fitted.",
            )
        )
    head = ("sensor", "density, /rtHz", "data sheet", "unit", "judged", "bias instability")
    table = Table("Noise", head, tuple(rows), numbers=frozenset({1, 2}))
    return Section("Noise at rest", tables=(table,), charts=tuple(charts))


def _points(name: str, title: str, labels: tuple[str, str], clouds: list[Cloud], *, note: str = "") -> Chart:
    curves = tuple(Curve(label, x, y) for label, x, y in clouds if len(x))
    return Chart(name, title, *labels, curves, kind="points", note=note)
