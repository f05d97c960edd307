"""What the kernel read beside the truth: the judgement of the tests, and a table for people."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from chips import FORCE_G, RATE_DEG_S, TEMP_DEGC, ramps

# The kernel's names of the ranges, with the data sheet's sensitivities (PS 6.1 and 6.2).
LSB_PER_G = {"0.000598": 16384.0, "0.001196": 8192.0, "0.002392": 4096.0, "0.004785": 2048.0}
LSB_PER_DEG_S = {"0.000133090": 131.0, "0.000266181": 65.5, "0.000532362": 32.8, "0.001064724": 16.4}
SENSORS = (("accel", LSB_PER_G, FORCE_G), ("anglvel", LSB_PER_DEG_S, RATE_DEG_S))


def compared(read: dict[str, Any]) -> Iterator[tuple[str, str, list[int], list[float]]]:
    """Sensor, scale, raw counts read on x y z, and the counts that the truth is; each scale the chip has."""
    for sensor, sensitivities, truth in SENSORS:
        for scale, lsb in sensitivities.items():
            yield sensor, scale, read[sensor].get(scale, []), [lsb * value for value in truth]


def mismatches(read: dict[str, Any]) -> list[str]:
    """Where what was read is not the count next to the truth, as "anglvel at 0.000133090"."""
    return [
        f"{sensor} at {scale}"
        for sensor, scale, raw, truth in compared(read)
        if len(raw) != 3 or any(abs(count - value) > 0.51 for count, value in zip(raw, truth, strict=True))
    ]


def temperature_degc(read: dict[str, Any]) -> float:
    """By the kernel's own offset and scale, which is in thousandths."""
    values = {key: float(value) for key, value in read["temperature"].items()}
    return (values["raw"] + values["offset"]) * values["scale"] / 1000


def table(release: str, seconds: float, jobs: dict[str, dict[str, Any]]) -> str:
    """All that was read beside the truth, and the time of each job."""
    lines = ["", f"Linux {release}, {seconds:.0f} s from QEMU's start to its end"]
    for name, result in jobs.items():
        verdict = "failed" if "error" in result else "done"
        lines.append(f"{name:20} {verdict:6} {result['seconds']:5.1f} s")
        if "accel" in result:
            for sensor, scale, raw, truth in compared(result):
                read_, true_ = (" ".join(f"{value:8.{n}f}" for value in row) for row, n in ((raw, 0), (truth, 1)))
                lines.append(f"    {sensor:8}{scale:12}read{read_}   truth{true_}")
        if "temperature" in result:
            lines.append(f"    temperature {temperature_degc(result):.3f} degC   truth {TEMP_DEGC} degC")
        if "rates" in result:
            rates = ", ".join(f"{text} Hz (divider {divider})" for text, divider in result["rates"].values())
            lines.append(f"    sampling frequencies {rates}")
        if "samples" in result:
            right = sum(
                got[:7] == list(true) for got, true in zip(result["samples"], ramps(1000).tolist(), strict=False)
            )
            lines.append(
                f"    {len(result['samples'])} samples, {right} of them right; {result['edges']} pulses of INT"
            )
        for line in result.get("doctor", [0, ""])[1].splitlines():
            finding = json.loads(line)
            lines.append(f"    {'ok' if finding['ok'] else '--':3} {finding['name']}: {finding['found']}")
    return "\n".join(lines)
