"""The page of a calibration: it opens without a network, the verdict in words first, then each sensor's pictures."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from quavelet.bench import session_pictures as pictures
from quavelet.bench.finding import Finding
from quavelet.bench.session_result import Result
from quavelet.calibration.allan import ACCEL, GOOD, GYRO, USUAL
from quavelet.calibration.model import IDENTITY, Matrix
from quavelet.core.blocks import FloatArray
from quavelet.core.units import DEG_PER_RAD, STANDARD_GRAVITY_M_S2
from quavelet.drawing.noise import BRACKETS, allan_charts, noise_table
from quavelet.drawing.page import Cell, Mark, Section, Table, html_page, write

AXES = "xyz"
ROOM_DEGC = 25.0


def write_report(
    path: Path, result: Result, findings: list[Finding], *, src: str, verdict: str, saved: str | None, reason: str
) -> None:
    """Write the page. Raises SettingsError without matplotlib, PageError where it cannot be written.

    src      what was calibrated, as the bus is named
    verdict  in a word, or a few
    saved    where the calibration is; None where it was not saved, and `reason` says why
    """
    if saved is None:
        headline = f"{reason[:1].upper()}{reason[1:]}."
    else:
        headline = f"{verdict.capitalize()}{', and' if verdict == 'good' else ', and all the same'} saved as {saved}."
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
        sections.append(_noise(result))
    foot = f"quavelet {result.record.made.version}"
    write(path, html_page("Calibration of a board", (headline, *_about(result, src)), sections, foot=foot).encode())


def _about(result: Result, src: str) -> list[str]:
    chip, made = result.record.chip, result.record.made
    about = (
        f"{chip.name} at address 0x{chip.address:02x} on {src}, worked out on {made.utc[:10]} at {made.utc[11:16]} "
        f"UTC; the chip was at {made.lowest_degc:.1f} to {made.highest_degc:.1f} degC; ranges {made.gyro_range_dps} "
        f"deg/s and {made.accel_range_g} g."
    )
    return [about, *(["This is a fake chip: NOT A REAL ONE."] if chip.is_fake else [])]


def _verdict(findings: list[Finding]) -> Section:
    def mark(one: Finding) -> Mark:
        return "bad" if not one.ok else "doubt" if one.advice else "good"

    head = ("part", "verdict", "found", "what to do")
    rows = [
        (Cell(one.name), Cell("good" if one.ok else "not good enough", mark(one)), Cell(one.found), Cell(one.advice))
        for one in findings
    ]
    columns = 4 if any(one.advice for one in findings) else 3
    table = Table("Before and after", head[:columns], tuple(row[:columns] for row in rows), cards=True)
    return Section("Verdict", tables=(table,))


def _accelerometer(result: Result) -> Section:
    fit = result.accel
    assert fit is not None, "shown only where it is"
    off = pictures.tilts_deg(result)
    words = (
        f"A board at rest was shown up to {off.max():.2f} deg away from its true tilt in these poses. What is left is "
        f"{DEG_PER_RAD * fit.tilt_sigma_rad:.2f} deg (one sigma). 1 mg (a thousandth of gravity) makes 0.06 deg.",
    )
    offset = [
        _with_sigma(1e3 * value / STANDARD_GRAVITY_M_S2, 1e3 * sigma, 2)
        for value, sigma in zip(fit.offset_m_s2, fit.sigma[:3], strict=True)
    ]
    table = _axes_table([("offset, mg", offset)], fit.matrix, fit.sigma[3:].reshape(3, 3))
    left = tuple(f"The poses do not show {name}: it is left as it was." for name in fit.undetermined)
    return Section("Accelerometer", words, (table,), pictures.accelerometer(result), left)


def _bias(result: Result) -> Section:
    fit = result.bias
    assert fit is not None, "shown only where it is"
    span = np.array([fit.lowest_degc, fit.highest_degc])
    at_degc = float(np.clip(ROOM_DEGC, *span))
    curve = fit.curve()
    bias = DEG_PER_RAD * curve.at(np.array([at_degc]))[0]
    low, high = DEG_PER_RAD * curve.at(span)
    slope = (high - low) / max(span[1] - span[0], 1e-9)
    moves = [f"{value:+.4f}" if span[1] - span[0] >= pictures.SHOWS_SLOPE_DEGC else "not seen" for value in slope]
    words = (
        "What the gyroscope reads while the board lies still, at each temperature. 0.01 deg/s that is left turns the "
        "heading by 0.6 deg in a minute; at each start the service measures anew what is left.",
    )
    head = ("axis", f"bias at {at_degc:.0f} degC, deg/s", "moves by, deg/s per degC")
    rows = tuple(
        (Cell(axis), Cell(_with_sigma(bias[k], DEG_PER_RAD * fit.sigma_at(at_degc), 3)), Cell(moves[k]))
        for k, axis in enumerate(AXES)
    )
    table = Table("What was found", head, rows, numbers=frozenset({1, 2}))
    return Section("Gyroscope bias", words, (table,), pictures.bias(result))


def _turns(result: Result) -> Section:
    fit = result.turns
    assert fit is not None, "shown only where it is"
    words = ("How much of a turn the gyroscope shows: 0.1 % of scale is 0.36 deg in a whole turn.",)
    table = _axes_table([], fit.matrix, fit.sigma.reshape(3, 3))
    left = tuple(f"The turns do not show {name}: it is left as it was." for name in fit.undetermined)
    return Section("Gyroscope scale", words, (table,), pictures.turns(fit), left)


def _field(result: Result) -> Section:
    fit = result.field
    assert fit is not None, "shown only where it is"
    words = (
        f"The field here is {fit.field_ut:.1f} uT strong, and was seen from {100 * fit.coverage:.0f} % of all "
        "directions. Calibrated, the points lie on a ball about the middle; iron on the board had moved and bent it.",
    )
    hard = [f"{value:+.2f}" for value in fit.calibration.hard_iron_ut]
    head = ("axis", "hard iron, uT", *(f"soft iron, {axis}" for axis in AXES))
    rows = tuple(
        (Cell(axis), Cell(hard[k]), *(Cell(f"{value:.4f}") for value in fit.calibration.soft_iron[k]))
        for k, axis in enumerate(AXES)
    )
    table = Table("What was found", head, rows, numbers=frozenset({1, 2, 3, 4}))
    return Section("Magnetometer", words, (table,), pictures.field(result))


def _noise(result: Result) -> Section:
    words = (
        f"Good is up to {GOOD:g} times the data sheet's noise density, usual up to {USUAL:g} times, as real boards "
        "are; more is poor. The bias instability is the flat part of the curve: no longer mean makes a bias surer.",
    )
    charts = allan_charts(result.noise, "session")
    return Section("Noise", words, (noise_table(result.noise),), charts, (BRACKETS, *_densities_si(result)))


def _densities_si(result: Result) -> Iterator[str]:
    for sheet, unit in ((GYRO, "rad/s"), (ACCEL, "m/s^2")):
        found = [
            (one.axis, one.fit.density.value) for one in result.noise if one.sheet is sheet and one.fit is not None
        ]
        if found:
            axes = ", ".join(f"{axis} {density:.3g}" for axis, density in found)
            yield f"The {sheet.name}'s density in SI: {axes} {unit}/rtHz."


def _axes_table(columns: list[tuple[str, list[str]]], matrix: Matrix, sigma: FloatArray) -> Table:
    """A row an axis: the columns given, then scale and misalignment of a matrix (3, 3) and its sigmas."""
    off = np.array(matrix) - np.array(IDENTITY)
    head = ("axis", *(name for name, _ in columns), "scale corrected by, %", *(f"leans to {a}, deg" for a in AXES))
    rows = []
    for k, axis in enumerate(AXES):
        lean = ["" if j == k else _with_sigma(DEG_PER_RAD * off[k, j], DEG_PER_RAD * sigma[k, j], 2) for j in range(3)]
        scale = _with_sigma(100.0 * off[k, k], 100.0 * sigma[k, k], 3)
        rows.append(tuple(Cell(text) for text in (axis, *(values[k] for _, values in columns), scale, *lean)))
    return Table("What was found", head, tuple(rows), numbers=frozenset(range(1, len(head))))


def _with_sigma(value: float, sigma: float, digits: int) -> str:
    return f"{value:+.{digits}f} ± {sigma:.{digits}f}"
