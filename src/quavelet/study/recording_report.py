"""One recording worked through: every method's attitude and figures, the sensors' noise, and its part of the page."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import isnan, nan

import numpy as np

from quavelet.calibration.calibrate import Calibrate
from quavelet.calibration.model import UNCALIBRATED
from quavelet.calibration.noise import AxisNoise, noise_of
from quavelet.core.blocks import AttitudeBlock, Flag, FloatArray, ImuBlock, concat
from quavelet.core.units import DEG_PER_RAD, NS_PER_S
from quavelet.drawing.chart import Chart, Curve
from quavelet.drawing.noise import BRACKETS, allan_charts, noise_table
from quavelet.drawing.page import Cell, Section, Table
from quavelet.pipeline import build_pipeline, mounted
from quavelet.recording.recorded import Recorded, Truth
from quavelet.settings import Settings
from quavelet.study.methods import DEFAULT, Method, methods
from quavelet.study.scores import Score, drawn_deg, errors_over_time, score, settled_from, still_rows

AXES, ANGLES = "xyz", ("roll", "pitch", "yaw")
NOISE_FROM_S = 10.0
"""Noise is measured in a still stretch of at least this."""
DRAWN_ROWS = 6000
"""A curve of more points is thinned before it is drawn: no screen has so many."""
ERROR_WINDOWS = 300


@dataclass(frozen=True, slots=True, eq=False)
class Ran:
    """A method and what it gave."""

    method: Method
    block: AttitudeBlock
    score: Score


@dataclass(frozen=True, slots=True, eq=False)
class Report:
    """All of it.

    still  rows of the longest stretch in which the board lay still
    start  the row from which on the methods are scored
    """

    recorded: Recorded
    imu: ImuBlock
    runs: tuple[Ran, ...]
    noise: tuple[AxisNoise, ...]
    still: slice
    start: int


def work_through(recorded: Recorded, base: Settings, *, tell: Callable[[str], None]) -> Report:
    """Every method over the recording, each as it would have run live; `tell` is called with each one's name."""
    blocks = []
    chosen = methods(base)
    for method in chosen:
        tell(method.name)
        pipeline = build_pipeline(method.settings)
        blocks.append(concat([pipeline.process(run) for run in recorded.runs]))
    # A filter that waits for later samples has not given the last ones.
    n = min(map(len, blocks))
    blocks = [block[:n] for block in blocks]
    if recorded.truth is not None:
        recorded = replace(recorded, truth=Truth(recorded.truth.q[:n], recorded.truth.scored[:n]))
    reference = blocks[[method.name for method in chosen].index(DEFAULT)]
    start = settled_from(reference)
    still = still_rows(reference, start=start)
    scores = [score(block, reference, still=still, start=start, truth=recorded.truth) for block in blocks]
    tell("noise")
    imu = concat([Calibrate(mounted(UNCALIBRATED, base)).process(run) for run in recorded.runs])[:n]
    runs = tuple(Ran(*one) for one in zip(chosen, blocks, scores, strict=True))
    return Report(recorded, imu, runs, _noise(imu[still]), still, start)


def section(report: Report, name: str) -> Section:
    """Its part of the page; `name` keeps the charts' file names apart."""
    recorded = report.recorded
    return Section(
        str(recorded.path),
        (_about(report), *(f"{text}." for text in (recorded.damage, recorded.note) if text)),
        (method_table(report), *([noise_table(report.noise)] if report.noise else [])),
        _charts(report, name),
        tuple(_remarks(report)),
    )


def figures(report: Report, ran: Ran) -> dict[str, float]:
    """The figures of a method that this recording can give, each by its name with the unit."""
    found: dict[str, float] = {}
    if report.recorded.truth is not None:
        found["rms tilt error, deg"] = ran.score.truth
        found["largest tilt error, deg"] = ran.score.truth_max
        found["heading error at the end, deg"] = ran.score.heading if ran.method.has_heading else nan
    found["vertical against the accelerometer, rms deg"] = ran.score.gravity
    if report.still.stop > report.still.start:
        for k, angle in enumerate(ANGLES):
            known = angle != "yaw" or ran.method.has_heading
            found[f"{angle} wander at rest, deg"] = ran.score.wander[k] if known else nan
            found[f"{angle} rms at rest, deg"] = ran.score.wander_rms[k] if known else nan
    found["apart from the default, rms deg"] = ran.score.apart
    return found


def method_table(report: Report) -> Table:
    """A row a figure, a column a method: so it fits a terminal."""
    by_method = [figures(report, ran) for ran in report.runs]
    rows = tuple((Cell(name), *(Cell(_deg(found[name])) for found in by_method)) for name in by_method[0])
    head = ("", *(ran.method.name for ran in report.runs))
    return Table("Methods side by side", head, rows, numbers=frozenset(range(1, len(head))))


def _noise(imu: ImuBlock) -> tuple[AxisNoise, ...]:
    """Both sensors' axes over a still stretch; nothing where it is too short."""
    if not len(imu) or len(imu) * float(imu.period_s[0]) < NOISE_FROM_S:
        return ()
    period_s = float(imu.t_ns[-1] - imu.t_ns[0]) / NS_PER_S / (len(imu) - 1)
    return noise_of([(imu.gyro_rad_s + imu.gyro_bias_rad_s, imu.accel_m_s2)], period_s=period_s)


def _about(report: Report) -> str:
    imu, recorded = report.imu, report.recorded
    gaps = int(((imu.flags & Flag.GAP) != 0).sum())
    lost_s = float(imu.gap_ns.sum()) / NS_PER_S
    still_s = (report.still.stop - report.still.start) * float(np.median(imu.period_s))
    words = [
        f"{len(imu)} samples over {recorded.seconds:.1f} s, {1.0 / float(np.median(imu.period_s)):.2f} a second; ",
        f"{gaps} gaps, {lost_s:.3f} s lost. " if gaps else "no gaps. ",
        f"Longest stretch at rest: {still_s:.0f} s. " if still_s else "The board never lay still. ",
        f"Figures count from {float(imu.t_ns[report.start] - imu.t_ns[0]) / NS_PER_S:.1f} s on, where the default is "
        "settled, or should be. ",
    ]
    if recorded.truth is not None:
        words.append(f"The file carries the measured attitude; {recorded.truth.scored.mean():.0%} of it is scored. ")
    return "".join(words).strip()


def _remarks(report: Report) -> list[str]:
    remarks = [
        *(f"{ran.method.name}: {ran.method.what}." for ran in report.runs),
        "Wander is the largest departure from the mean at rest, yaw's is drift: six axes do not know the heading.",
    ]
    if report.recorded.truth is None:
        remarks.append(
            "No truth in this file: the accelerometer's vertical is believed where its norm is within 3 % of the usual "
            "and the rate below 20 deg/s. A method that copies the accelerometer is near it by itself."
        )
    if not any((ran.block.flags & (Flag.BIAS_UNKNOWN | Flag.SETTLING) == 0).any() for ran in report.runs):
        remarks.append("No method ever said that its attitude can be trusted.")
    if report.noise:
        remarks.append(BRACKETS)
    return remarks


def _charts(report: Report, name: str) -> tuple[Chart, ...]:
    t_s = (report.imu.t_ns - report.imu.t_ns[0]) / NS_PER_S
    every = slice(None, None, max(1, len(t_s) // DRAWN_ROWS))
    # What comes before the default is settled would set the scale of all that is after.
    settled = slice(report.start, None, every.step)
    x: FloatArray = t_s[settled]
    charts = []
    for k, angle in enumerate(ANGLES):
        shown = [ran for ran in report.runs if angle != "yaw" or ran.method.has_heading]
        curves = [Curve(ran.method.name, x, drawn_deg(ran.block.q[settled])[:, k]) for ran in shown]
        if (truth := report.recorded.truth) is not None and angle != "yaw":
            true = np.where(truth.scored[settled], drawn_deg(truth.q[settled])[:, k], nan)
            curves.append(Curve("truth", x, true, dashed=True))
        note = "Relative: it counts from where the board was at the start." if angle == "yaw" else ""
        charts.append(
            Chart(f"{name}-{angle}", angle.capitalize(), "time, s", f"{angle}, deg", tuple(curves), note=note)
        )
    if (truth := report.recorded.truth) is not None:
        window = max(1, round(1.0 / float(np.median(report.imu.period_s))), len(t_s) // ERROR_WINDOWS)
        errors = tuple(
            Curve(ran.method.name, *errors_over_time(ran.block, truth, start=report.start, window=window))
            for ran in report.runs
        )
        label = f"rms of {window * float(np.median(report.imu.period_s)):.0f} s, deg"
        charts.append(Chart(f"{name}-error", "Tilt error", "time, s", label, errors, log_y=True))
    rate = DEG_PER_RAD * report.imu.gyro_rad_s
    force = report.imu.accel_m_s2
    for values, stem, title, unit in ((rate, "rate", "Rate", "deg/s"), (force, "force", "Specific force", "m/s^2")):
        axes = tuple(Curve(axis, t_s[every], values[every, k]) for k, axis in enumerate(AXES))
        charts.append(Chart(f"{name}-{stem}", f"{title}, as measured", "time, s", f"{title.lower()}, {unit}", axes))
    return (*charts, *allan_charts(report.noise, name))


def _deg(value: float) -> str:
    return "" if isnan(value) else f"{value:.3f}"
