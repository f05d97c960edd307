"""Paper 000, Liu Chun et al. 2020: attitude by wavelets and a PID complementary filter, methods 1 to 5."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from quavelet.attitude.kernel import Method, Quaternion, step
from quavelet.attitude.params import FilterParams
from quavelet.core.blocks import FloatArray
from quavelet.core.euler import from_euler, to_euler
from quavelet.core.quaternion import angle_between, from_matrix, to_matrix
from quavelet.core.units import DEG_PER_RAD, RAD_PER_DEG
from quavelet.denoise.offline import Reading, paper_000
from quavelet.drawing.chart import Chart, Curve
from quavelet.study.experiment import Effort, Experiment, Progress, Result, Row, Verdict
from quavelet.study.paper000_runs import (
    ACCELEROMETER,
    GATED,
    GYRO,
    PER_SAMPLE,
    RATE_HZ,
    RAW_DERIVATIVE,
    P,
    Recorded,
    attitude,
    errors_deg,
    led,
    recorded,
    still,
    turned,
)

AXES = ("roll", "pitch", "heading")
SEED, MOVING_SEED, TURN_SEED, RAMP_SEED = 20201230, 20201231, 7, 5


@dataclass(frozen=True, slots=True)
class Way:
    """A method: how its rows are called, the filter, what is done to the rate first, and the paper's largest errors."""

    name: str
    params: FilterParams
    reading: Reading | None = None
    printed: tuple[str, str, str] = ("", "", "")


WAYS = (
    Way("1 accelerometer", ACCELEROMETER, None, (".0373", ".0412", ".0802")),
    Way("2 gyroscope", GYRO, None, (".0394", ".0359", ".0728")),
    Way("3 P", P, None, (".0285", ".0441", ".0291")),
    Way("4 PID", PER_SAMPLE, None, (".0223", ".0317", ".0202")),
    Way("4 PID, true derivative", RAW_DERIVATIVE),
    Way("5A low band zeroed, loop closed", PER_SAMPLE, "A"),
    Way("5B low band zeroed, error zero", GYRO, "A", (".0051", ".0054", ".0052")),
    Way("5C details shrunk", PER_SAMPLE, "C"),
    Way("5D low band zeroed, details shrunk", PER_SAMPLE, "D"),
    Way("gated", GATED),
)
B_IS = "the literal text: gravity from the accelerometer's own attitude, so that the error is zero at all times"

Errors = dict[str, FloatArray]
"""Errors of each way, (runs, N, 3) in deg, roll, pitch, heading."""


def _run(effort: Effort, progress: Progress) -> Result:
    full = effort is Effort.FULL
    lying, example = _all_ways(still(), 24 if full else 4, SEED, lambda k: progress(0.6 * k, "lying still"))
    moving, _ = _all_ways(led(), 8 if full else 1, MOVING_SEED, lambda k: progress(0.6 + 0.3 * k, "led"))
    progress(0.9, "slow turns and bias ramps")
    rows = [
        *_kernel_rows(),
        *_still_rows(lying, full=full),
        *_moving_rows(moving),
        *_turn_rows(4 if full else 1),
        *_ramp_rows(),
    ]
    return Result(tuple(rows), (*_angle_charts(lying), _rate_chart(example), _bars(lying), _led_chart(moving)), REMARKS)


def _all_ways(angles: FloatArray, runs: int, seed: int, progress: Callable[[float], None]) -> tuple[Errors, Recorded]:
    rng = np.random.default_rng(seed)
    found: dict[str, list[FloatArray]] = {way.name: [] for way in WAYS}
    for k in range(runs):
        progress(k / runs)
        r = recorded(angles, rng)
        for way in WAYS:
            found[way.name].append(errors_deg(r, attitude(r, way.params, reading=way.reading)))
    return {name: np.stack(errors) for name, errors in found.items()}, r


def _sd(errors: FloatArray) -> FloatArray:
    sd: FloatArray = np.median(errors.std(axis=1, ddof=1), axis=0)
    return sd


def _largest(errors: FloatArray) -> FloatArray:
    """The median of the runs' largest errors."""
    largest: FloatArray = np.median(np.abs(errors).max(axis=1), axis=0)
    return largest


def _still_rows(e: Errors, *, full: bool) -> list[Row]:
    sd = {name: _sd(errors) for name, errors in e.items()}
    largest = {name: _largest(errors) for name, errors in e.items()}
    first, p, pid, trap, a, b, c = (
        WAYS[0].name, WAYS[2].name, WAYS[3].name, WAYS[4].name, WAYS[5].name, WAYS[6].name, WAYS[7].name,
    )  # fmt: skip
    rows = []
    for i, axis in enumerate(AXES[:2]):
        rows.append(Row("0a", f"still, {first}, sd, {axis}", got=float(sd[first][i]), unit="deg", low=0.146, high=0.178,
                        note="the accelerometer's noise by the data sheet"))  # fmt: skip
        for name in (p, pid):
            rows += [
                Row("0b", f"still, {name}, sd, {axis}", got=float(sd[name][i]), unit="deg", low=0.010, high=0.014),
                Row("0b", f"still, {name}, largest, {axis}", got=float(largest[name][i]), unit="deg", high=0.055),
            ]
        rows += [
            Row("0c", f"still, {trap}, sd, {axis}", got=float(sd[trap][i]), unit="deg", low=0.08, high=0.11,
                note="an unfiltered derivative passes the accelerometer's noise on, 0.577 of it"),
            Row("0d", f"still, 5A over 4, sd, {axis}", got=float(sd[a][i] / sd[pid][i]), unit="", low=0.85, high=1.10,
                printed="0.2", verdict=Verdict.REFUTED,
                note="with the loop closed the accelerometer's noise is the floor, which no filter of the rate lowers"),
            Row("0e", f"still, {b}, sd, {axis}", got=float(sd[b][i]), unit="deg", low=0.0, high=0.0005),
            Row("0f", f"still, 5C over 4, largest, {axis}", got=float(largest[c][i] / largest[pid][i]), unit="",
                low=0.95, high=1.05, note="integration is a low-pass already"),
        ]  # fmt: skip
    for way in WAYS:
        rows += _printed(way, largest[way.name], bands=full)
    return rows + _gated_rows(e, largest[pid], full=full)


def _printed(way: Way, largest: FloatArray, *, bands: bool) -> list[Row]:
    rows = []
    for i, axis in enumerate(AXES):
        if way.params.kind == "accelerometer" and axis == "heading":
            continue
        b = way.name.startswith("5B")
        rows.append(
            Row("0e" if b and i < 2 else f"T{3 - i}", f"still, {way.name}, largest, {axis}", got=float(largest[i]),
                unit="deg", printed=way.printed[i], high=0.012 if b and i < 2 and bands else np.inf,
                verdict=Verdict.READING if b else Verdict.NONE, reading=B_IS if b else "",
                note="a frozen attitude, no accuracy: what is left is the start's error" if b else "")
        )  # fmt: skip
    return rows


def _gated_rows(e: Errors, pid: FloatArray, *, full: bool) -> list[Row]:
    late = e["gated"][:, round(20.0 * RATE_HZ) :]
    late = late - np.array([0.0, 0.0, 1.0]) * late[:, :1]
    largest, p95 = _largest(late), np.percentile(np.abs(late).max(axis=1), 95.0, axis=0)
    limits = (0.008, 0.008, 0.001)
    rows = [
        Row("0g", f"still, gated from 20 s on, largest, {axis}", got=float(largest[i]), unit="deg", low=0.0,
            high=limits[i] if full else 2.0 * limits[i])
        for i, axis in enumerate(AXES)
    ]  # fmt: skip
    for i, axis in enumerate(AXES[:2]):
        rows.append(Row("0g", f"still, gated, better than 4 by, {axis}", got=float(1.0 - largest[i] / pid[i]), unit="",
                        printed="0.80", low=0.80 if full else -np.inf, verdict=Verdict.READING,
                        reading="the low band is taken away only while the board is still"))  # fmt: skip
        if full:
            rows.append(Row("0g", f"still, gated from 20 s on, p95 of largest, {axis}", got=float(p95[i]), unit="deg",
                            low=0.0, high=0.015))  # fmt: skip
    return rows


def _moving_rows(e: Errors) -> list[Row]:
    rows = []
    limits = (0.04, 0.05, 0.25)
    for way in WAYS:
        rms = np.sqrt((e[way.name] ** 2).mean(axis=(0, 1)))
        for i, axis in enumerate(AXES):
            if way.params.kind == "accelerometer" and axis == "heading":
                continue
            judged = way.name == "gated"
            rows.append(Row("0h" if judged else "M", f"led, {way.name}, rms, {axis}", got=float(rms[i]), unit="deg",
                            low=0.0 if judged else -np.inf, high=limits[i] if judged else np.inf))  # fmt: skip
    a = float(np.median(np.abs(e[WAYS[5].name][:, -1, 2])))
    rows.append(Row("0h", "led, 5A, error of heading at the end of 120 deg", got=a, unit="deg", low=110.0, high=121.0,
                    verdict=Verdict.REFUTED, note="without its low band the rate has no motion in it"))  # fmt: skip
    return rows


def _turn_rows(runs: int) -> list[Row]:
    rows = []
    for rate, turn, limit in ((0.5, 30.0, 0.3), (0.1, 12.0, 0.6), (0.05, 6.0, np.inf), (0.02, 2.4, np.inf)):
        rng = np.random.default_rng(TURN_SEED)
        last = []
        for _ in range(runs):
            r = recorded(turned(rate, turn), rng)
            last.append(errors_deg(r, attitude(r, GATED))[-1, 2])
        rows.append(
            Row("0i", f"turned {turn:g} deg at {rate:g} deg/s, gated, error at the end, rms",
                got=float(np.sqrt(np.mean(np.square(last)))), unit="deg", high=limit,
                note="below 0.03 deg/s a turn is taken for a bias and lost" if rate < 0.03 else "")
        )  # fmt: skip
    return rows


def _ramp_rows() -> list[Row]:
    rows = []
    for relearn_s in (10.0, 0.0):
        r = recorded(np.zeros((round(180.0 * RATE_HZ), 3)), np.random.default_rng(RAMP_SEED), ramp_deg_s_min=0.1)
        off = abs(float(errors_deg(r, attitude(r, FilterParams(relearn_s=relearn_s)))[-1, 2]))
        what = "with" if relearn_s else "without"
        rows.append(
            Row("0j", f"bias growing by 0.1 deg/s a minute, 180 s, gated {what} relearning, heading", got=off,
                unit="deg", high=6.0 if relearn_s else np.inf,
                note="" if relearn_s else "heading is flagged as suspect: a slow turn would look the same")
        )  # fmt: skip
    return rows


def _kernel_rows() -> list[Row]:
    rng = np.random.default_rng(1)
    q = rng.standard_normal((200, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    matrix = to_matrix(q)
    trips = [np.abs(matrix @ np.swapaxes(matrix, 1, 2) - np.eye(3)).max(), angle_between(q, from_matrix(matrix)).max()]
    for order in ("zyx", "zxy"):
        trips.append(angle_between(q, from_euler(to_euler(q, order=order), order=order)).max())
    rows = [Row("G1", "random attitudes through matrix and angles and back", got=float(max(trips)), unit="rad",
                low=0.0, high=1e-12)]  # fmt: skip
    bands: dict[Method, tuple[float, float]] = {"rk1": (0.15, 0.25), "rk4": (0.0, 1e-4), "exp": (0.0, 1e-8)}
    for method, (low, high) in bands.items():
        turn: Quaternion = (1.0, 0.0, 0.0, 0.0)
        for _ in range(1000):
            turn = step(turn, (0.0, 0.0, 200.0 * RAD_PER_DEG), 0.01, method)
        exact = from_euler(np.array([0.0, 0.0, 2000.0 * RAD_PER_DEG]))
        off = DEG_PER_RAD * float(angle_between(np.array(turn), exact))
        rows.append(Row("G2", f"200 deg/s for 10 s, {method}", got=off,
                        unit="deg", low=low, high=high))  # fmt: skip
    w, x, y, z = from_euler(np.array([0.3, 0.2, 0.5])).tolist()
    yaw = float(to_euler(np.array([w, x, y, z]))[2])
    printed = float(np.arctan(2.0 * (x * y + w * z) / (1.0 - (y * y + z * z))))
    rows += [
        Row("G3", "equation 4 corrected, heading of 0.5 rad off by", got=abs(yaw - 0.5), unit="rad", low=0.0,
            high=1e-12),
        Row("G3", "equation 4 as printed, heading of 0.5 rad", got=printed, unit="rad", low=0.4675, high=0.4685,
            verdict=Verdict.REFUTED, note="the 2 before the bracket of the denominator is missing"),
    ]  # fmt: skip
    return rows


SHOWN = ("2 gyroscope", "3 P", "4 PID", "5B low band zeroed, error zero", "gated")


def _angle_charts(e: Errors) -> tuple[Chart, ...]:
    t = np.arange(e["gated"].shape[1]) / RATE_HZ
    charts = []
    for i, axis in enumerate(AXES):
        names = SHOWN if axis == "heading" else (WAYS[0].name, *SHOWN)
        charts.append(
            Chart(f"000-still-{axis}", f"A board that lies still, {axis}", "time, s", f"{axis}, deg",
                  tuple(Curve(name, t[::5], e[name][0, ::5, i]) for name in names),
                  note="Method 5 as the paper has it is a straight line because nothing can move it.")
        )  # fmt: skip
    return tuple(charts)


def _rate_chart(r: Recorded) -> Chart:
    rows = slice(0, round(4.0 * RATE_HZ))
    rate = r.gyro_rad_s - r.bias_rad_s
    curves = [
        ("measured", rate),
        ("5C: details shrunk", paper_000(rate)),
        ("5A: low band zeroed", paper_000(rate, reading="A")),
    ]
    t = np.arange(len(rate))[rows] / RATE_HZ
    return Chart("000-rate", "The rate before and after the wavelets, z axis", "time, s", "rate, deg/s",
                 tuple(Curve(name, t, DEG_PER_RAD * values[rows, 2]) for name, values in curves))  # fmt: skip


def _bars(e: Errors) -> Chart:
    return Chart(
        "000-largest", "Largest error of a board that lies still", "", "largest error, deg (median of runs)",
        tuple(
            Curve(way.name, np.arange(2.0), np.maximum(_largest(e[way.name])[:2], 1e-4)) for way in WAYS
        ),
        kind="bars", ticks=AXES[:2], log_y=True,
        note="Gated counts from the first second, before the bias is known well.",
    )  # fmt: skip


def _led_chart(e: Errors) -> Chart:
    t = np.arange(e["gated"].shape[1]) / RATE_HZ
    true = DEG_PER_RAD * led()[:, 2]
    names = ("4 PID", "5A low band zeroed, loop closed", "gated")
    return Chart(
        "000-led-heading", "A board that is turned by 120 deg", "time, s", "heading, deg",
        (*(Curve(name, t[::10], (true + e[name][0, :, 2])[::10]) for name in names),
         Curve("truth", t[::10], true[::10], dashed=True)),
        note="With its low band the rate loses every motion of a hand or a vehicle.",
    )  # fmt: skip


REMARKS = (
    "Equation 6 gives a heading from the accelerometer, which no accelerometer knows: it is equation 8 once more. "
    "Method 1 has no heading here.",
    "Of four readings of 'remove the low-frequency component', B was picked because it gives the paper's numbers.",
    "Every figure of a thousandth of a degree is repeatability after the offset is removed: 5 mg of zero-g offset, a "
    "good calibration, are 0.29 deg.",
    "Equations 2, 3, 7 and 8 are corrected: as printed the matrix is not orthogonal, the quaternion has no unit "
    "length, and pitch has the wrong sign.",
)
EXPERIMENT = Experiment(
    "000",
    "Attitude by wavelets and a PID complementary filter",
    "80 % better than PID: as read literally it is, because the attitude is frozen; taken away only while still, the "
    "low band gives as much and keeps the motion.",
    _run,
)
