"""What is true of the rows of every paper about alignment."""

from __future__ import annotations

import numpy as np

from quavelet.study.experiment import Result, Verdict


def assert_sound(result: Result, *, ids: set[str]) -> None:
    """Rows of these acceptance ids are judged, each row in its band is, and each verdict says why."""
    assert ids <= {row.id for row in result.rows if row.judged}
    assert [f"{row.id} {row.what}: {row.got}" for row in result.rows if not row.passed] == []
    assert [row.what for row in result.rows if not np.isfinite(row.got)] == []
    assert [row.what for row in result.rows if row.verdict is Verdict.READING and not row.reading] == []
    assert [row.what for row in result.rows if row.verdict is Verdict.REFUTED and not row.note] == []
    assert len({(row.id, row.what) for row in result.rows}) == len(result.rows)
    for chart in result.charts:
        for curve in chart.curves:
            assert len(curve.x) == len(curve.y) > 1
            assert np.isfinite(curve.y).all(), (chart.name, curve.label)
