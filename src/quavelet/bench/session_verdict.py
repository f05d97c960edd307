"""Is the calibration good enough? Before and after on poses that no fit has seen, and against the data sheet."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from quavelet.bench.finding import Finding
from quavelet.bench.session_result import Result
from quavelet.calibration import accelerometer, turns
from quavelet.calibration.model import UNCALIBRATED, ImuCalibration
from quavelet.calibration.noise import AxisNoise
from quavelet.calibration.poses import StillPose
from quavelet.core.blocks import FloatArray
from quavelet.core.units import DEG_PER_RAD, RAD_PER_DEG, STANDARD_GRAVITY_M_S2

GOOD_G = 0.005
"""Makes 0.3 deg of tilt; the data sheet allows 50 to 80 mg (PS 6.2)."""
GOOD_TILT_DEG = 0.12
"""One sigma of tilt by faces that the board was put on; in the worst of all attitudes it is 0.3 deg."""
GOOD_DPS = 0.05
"""What the bias may be off by at rest within the session; the data sheet allows 20 deg/s (PS 6.1)."""
PER_G_DPS = 0.1
"""What 1 g may add to it (PS 6.1), where the board was measured in too few attitudes to know."""
KNOWN_ATTITUDES = 4
GOOD_SCALE = 0.003
"""Of a turned angle, one sigma; the data sheet allows 3 % (PS 6.1)."""
GOOD_FIELD = 0.03
SHEET_DPS = 20.0


def forces_g(poses: list[StillPose], calibration: ImuCalibration) -> FloatArray:
    """The forces (N, 3) of poses by a calibration, g."""
    measured = np.array([pose.accel_m_s2 for pose in poses]).reshape(-1, 3)
    true: FloatArray = (measured - calibration.accel_offset_m_s2) @ np.array(calibration.accel_matrix).T
    return true / STANDARD_GRAVITY_M_S2


def rates_dps(poses: list[StillPose], calibration: ImuCalibration) -> FloatArray:
    """The rates (N, 3) that poses at rest have by a calibration, deg/s: what is left of the bias."""
    rates: FloatArray = np.array([pose.gyro_rad_s for pose in poses]).reshape(-1, 3)
    if calibration.gyro_bias_curve is not None:
        rates = rates - calibration.gyro_bias_curve.at(np.array([pose.temp_degc for pose in poses]))
    force = forces_g(poses, calibration) * STANDARD_GRAVITY_M_S2
    rates = (rates - force @ np.array(calibration.gyro_per_force).T) @ np.array(calibration.gyro_matrix).T
    return DEG_PER_RAD * rates


def verdict(result: Result) -> list[Finding]:
    """One finding for each part that was to be calibrated; the calibration is good enough where all are ok."""
    calibration, check = result.record.calibration(), result.evidence.check
    found: list[Finding] = []
    if result.accel is not None:
        found.append(_accelerometer(result, calibration, check))
    if result.bias is not None:
        found.append(_bias(result, calibration, check))
    if result.turns is not None:
        found.append(_scale(result))
    if result.field is not None:
        after = result.field.rms_after
        found.append(
            Finding(
                name="magnetometer",
                ok=after <= GOOD_FIELD,
                found=f"strength within {100 * after:.1f} % rms, {100 * result.field.rms_before:.0f} % before",
                advice="" if after <= GOOD_FIELD else "turn it away from iron and cables, and once more",
                figures={
                    "before_percent": round(100 * result.field.rms_before, 3),
                    "after_percent": round(100 * after, 3),
                },
            )
        )
    if result.noise:
        found += _noise(result.noise)
    found += [Finding(name=name, ok=False, found="not calibrated", advice=why) for name, why in result.refused.items()]
    found += _beyond_sheet(result)
    if not found:
        found.append(Finding(name="calibration", ok=False, found="nothing was measured", advice="take more steps"))
    return [*found, *_kept(result)]


def _accelerometer(result: Result, calibration: ImuCalibration, check: list[StillPose]) -> Finding:
    if not check:
        return _unchecked("accelerometer")
    before, after = (_off_g(check, one) for one in (UNCALIBRATED, calibration))
    worse = after > before and after > GOOD_G / 5
    assert result.accel is not None, "judged only where it is"
    missing = result.accel.undetermined
    tilt_deg = result.accel.tilt_sigma_rad * DEG_PER_RAD
    # The norms of any poses do not show that the faces were met badly; how they agree does.
    astray = result.accel.frame == "faces" and tilt_deg > GOOD_TILT_DEG
    advice = ""
    if astray:
        advice = (
            f"its faces do not agree, and leave {tilt_deg:.2f} deg of tilt (one sigma): put it on them flat, against "
            "something square, with nothing under it"
        )
    elif worse or after > GOOD_G:
        advice = "put the board on its faces more exactly, hold it stiller, and calibrate once more"
    elif missing:
        advice = f"not shown by these poses, and left as they were: {', '.join(missing)}; more poses show them"
    return Finding(
        name="accelerometer",
        ok=not worse and after <= GOOD_G and not astray,
        found=f"1 g within {1e3 * after:.1f} mg rms in {len(check)} poses held out, {1e3 * before:.1f} mg before",
        advice=advice,
        figures={
            "before_mg": round(1e3 * before, 3),
            "after_mg": round(1e3 * after, 3),
            "tilt_sigma_deg": round(tilt_deg, 4),
        },
    )


def _off_g(poses: list[StillPose], calibration: ImuCalibration) -> float:
    return float(np.sqrt(((np.linalg.norm(forces_g(poses, calibration), axis=1) - 1.0) ** 2).mean()))


def _bias(result: Result, calibration: ImuCalibration, check: list[StillPose]) -> Finding:
    if not check:
        return _unchecked("gyroscope bias")
    before, after = (
        float(np.sqrt((rates_dps(check, one) ** 2).mean(axis=0)).max()) for one in (UNCALIBRATED, calibration)
    )
    few = len(result.evidence.placed) + len(result.evidence.poses) < KNOWN_ATTITUDES
    ok = after <= GOOD_DPS + (PER_G_DPS if few else 0.0) and (after <= before or after <= GOOD_DPS / 5)
    curve = calibration.gyro_bias_curve
    advice = "" if ok else "the bias moved meanwhile: let the board come to its temperature, and calibrate once more"
    if ok and curve is not None and not curve.is_known:
        span = curve.highest_degc - curve.lowest_degc
        advice = (
            f"known over {span:.1f} degC only, so it is measured anew at each start (a temperature step shows more)"
        )
    return Finding(
        name="gyroscope bias",
        ok=ok,
        found=f"{after:.3f} deg/s rms left in {len(check)} poses held out, {before:.2f} deg/s before",
        advice=advice,
        figures={"before_dps": round(before, 4), "after_dps": round(after, 4)},
    )


def _scale(result: Result) -> Finding:
    assert result.turns is not None, "judged only where it is"
    sigma = result.turns.scale_sigma
    off = np.abs(np.array(result.turns.matrix) - np.eye(3)).max()
    ok = sigma <= GOOD_SCALE
    return Finding(
        name="gyroscope scale",
        ok=ok,
        found=f"a turned angle is right within {100 * sigma:.2f} %, it was up to {100 * off:.1f} % off",
        advice="" if ok else "the turns do not agree: turn on a flat table, against an edge, and back to it exactly",
        figures={"sigma_percent": round(100 * sigma, 4), "largest_percent": round(100 * float(off), 4)},
    )


def _kept(result: Result) -> Iterator[Finding]:
    """What is an older calibration's: not judged, but told where the poses of this session contradict it."""
    merged, check = result.merged, result.evidence.check
    for part in merged.kept:
        found = f"kept from {result.record.made_of(part).utc}"
        found += f"; of the one made anew: {merged.worse[part]}" if part in merged.worse else ""
        off_g = _off_g(check, result.record.calibration()) if part == "accelerometer" and check else 0.0
        contradicted = f"1 g is {1e3 * off_g:.0f} mg off by it: calibrate it anew, by the steps 'faces' and 'poses'"
        advice = contradicted if off_g > GOOD_G else ""
        yield Finding(name=_full(part), ok=True, found=found, advice=advice)
    for part, why in merged.left.items():
        yield Finding(name=_full(part), ok=False, found="the older one cannot be kept beside this", advice=why)


def _full(part: str) -> str:
    return part.replace("gyro_", "gyroscope ")


def _unchecked(name: str) -> Finding:
    return Finding(
        name=name, ok=False, found="calibrated, but no pose was held out to judge by", advice="take the step 'check'"
    )


def _noise(noise: tuple[AxisNoise, ...]) -> Iterator[Finding]:
    for sheet in dict.fromkeys(one.sheet for one in noise):
        fits = [one.fit for one in noise if one.sheet is sheet and one.fit is not None]
        if not fits:
            continue
        worst = max(fit.density.value for fit in fits)
        seen = [fit.instability.value / sheet.unit_si for fit in fits if fit.instability.seen]
        instability = f"{max(seen):.2g} {sheet.unit}" if seen else "too small for so short a run"
        word = sheet.word(worst)
        unit = f"{sheet.unit.replace('deg/s', 'dps')}_rthz"
        yield Finding(
            name=f"{sheet.name} noise",
            ok=True,
            found=f"{word}: {worst / sheet.unit_si:.3g} {sheet.unit}/rtHz at most, the data sheet says "
            f"{sheet.density:g}; bias instability {instability}",
            advice="" if word != "poor" else "look for vibration, a weak supply, or a damaged chip",
            figures={f"density_{unit}": round(worst / sheet.unit_si, 6), f"sheet_{unit}": sheet.density},
        )


def _beyond_sheet(result: Result) -> Iterator[Finding]:
    """What no chip of the data sheet has: a note, for the calibration takes it off all the same."""
    beyond: list[str] = []
    if result.accel is not None:
        offset = np.abs(result.accel.offset_m_s2) / STANDARD_GRAVITY_M_S2
        errors = np.append(offset, np.abs(np.array(result.accel.matrix) - np.eye(3)).ravel())
        names = zip(accelerometer.NAMES, errors, accelerometer.LIMITS, strict=True)
        beyond += [f"accelerometer {name}" for name, error, limit in names if error > 1.3 * limit]
    if result.turns is not None:
        errors = np.abs(np.array(result.turns.matrix) - np.eye(3)).ravel()
        pairs = zip(turns.NAMES, errors, turns.LIMITS, strict=True)
        beyond += [f"gyroscope {name}" for name, error, limit in pairs if error > 1.3 * limit]
    if result.bias is not None:
        bias = np.abs(result.bias.coefficients_rad_s[0]) / RAD_PER_DEG
        beyond += [f"gyroscope bias {a}" for a, b in zip("xyz", bias, strict=True) if b > SHEET_DPS]
    if beyond:
        yield Finding(
            name="data sheet",
            ok=True,
            found=f"beyond its limits: {', '.join(beyond)}",
            advice="it is taken off all the same, but such a chip is a doubtful one, or the board was not placed well",
        )
