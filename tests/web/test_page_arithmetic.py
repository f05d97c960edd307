"""What the page reckons by itself, run by node: orientation, and what of ten minutes is drawn."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from quavelet.core.euler import from_euler
from quavelet.core.quaternion import to_matrix

PAGE = Path(__file__).resolve().parents[2] / "src" / "quavelet" / "web" / "page"


def node(code: str, given: object = None) -> Any:
    """What `code`, a module beside the page's own, gives to `out`; `given` is what it is given."""
    program = shutil.which("node")
    if program is None:
        pytest.skip("node is not here")
    head = (
        "import { readFileSync } from 'node:fs';\n"
        "const given = JSON.parse(readFileSync(0, 'utf8'));\n"
        "const out = (value) => console.log(JSON.stringify(value));\n"
    )
    module = (head + code).replace('"./', f'"{PAGE.as_uri()}/')
    command = [program, "--no-warnings", "--experimental-default-type=module", "--input-type=module", "-e", module]
    done = subprocess.run(command, input=json.dumps(given), capture_output=True, text=True, check=False, cwd=PAGE)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def orientations() -> np.ndarray[Any, np.dtype[np.float64]]:
    random = np.random.default_rng(8).normal(size=(300, 4))
    corners = np.array([[a, b, c, d] for a in (0, 1, -1) for b in (0, 1) for c in (0, 1) for d in (0, -1)], float)[1:]
    q = np.concatenate([random, corners[np.linalg.norm(corners, axis=1) > 0]])
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def test_the_drawn_orientation_is_read_back_wrong():
    q = orientations()
    code = """
    import { matrixOf, quaternionOf } from "./view.js";
    const m = new Float64Array(9), back = new Float64Array(4);
    out(given.map((q) => (matrixOf(q, m), quaternionOf(m, back), [Array.from(m), Array.from(back)])));
    """
    result = node(code, q.tolist())
    matrices = np.array([m for m, _ in result]).reshape(-1, 3, 3)
    np.testing.assert_allclose(matrices, to_matrix(q), atol=1e-14)
    back = np.array([b for _, b in result])
    assert (back[:, 0] >= 0).all()
    np.testing.assert_allclose(np.abs((back * q).sum(axis=1)), 1.0, atol=1e-12)


def test_the_viewer_stands_where_left_is_right():
    code = """
    import { BACK, RIGHT, UP, View } from "./view.js";
    const view = new View(), at = [0, 0, 0];
    view.resize(800, 600);
    const see = (p) => (view.project(...p, at), [...at]);
    out({ BACK, RIGHT, UP, o: see([0, 0, 0]), x: see([1, 0, 0]), y: see([0, 1, 0]), z: see([0, 0, 1]) });
    """
    seen = node(code)
    camera = np.array([seen["RIGHT"], seen["UP"], seen["BACK"]])
    np.testing.assert_allclose(camera @ camera.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(camera) == pytest.approx(1.0)
    o, x, y, z = (np.array(seen[name]) for name in "oxyz")
    # From behind and above: x goes away, y to the left, z up.
    assert x[2] < o[2] and x[1] < o[1]
    assert y[0] < o[0]
    assert z[1] < o[1] and abs(z[0] - o[0]) < 1e-9


def test_roll_lifts_the_wrong_side():
    q = from_euler(np.radians([[30.0, 0.0, 0.0], [0.0, 30.0, 0.0], [0.0, 0.0, 30.0]]))
    code = """
    import { matrixOf } from "./view.js";
    const m = new Float64Array(9);
    out(given.map((q) => (matrixOf(q, m), Array.from(m))));
    """
    roll, pitch, yaw = np.array(node(code, q.tolist())).reshape(3, 3, 3)
    assert roll[2, 1] == pytest.approx(0.5)  # y's end is up
    assert pitch[2, 0] == pytest.approx(-0.5)  # x's end is down
    assert yaw[1, 0] == pytest.approx(0.5)  # x turns towards y, counter-clockwise from above


def test_a_peak_or_a_gap_is_lost_when_ten_minutes_are_drawn():
    code = """
    import { CHANNELS, Drawn, Ring } from "./ring.js";
    const ring = new Ring(), drawn = new Drawn(1200), row = new Float64Array(CHANNELS.length);
    const n = 40000, dt = 1 / 30;
    for (let k = 0; k < n; k++) {
      row.fill(Math.sin(k / 900));
      if (k === n - 9001) row[3] = 77;
      if (k === n - 5001) row[4] = -55;
      ring.add(1000 + k * dt, k === n - 3000 ? 0.02 : 0, row);
    }
    const to_s = ring.last_s;
    drawn.take(ring, to_s - 600, to_s, 400);
    const y = (c) => Array.from(drawn.y[c].subarray(0, drawn.rows));
    const x = Array.from(drawn.x.subarray(0, drawn.rows));
    out({ rows: drawn.rows, held: ring.rows, most: Math.max(...y(3)), least: Math.min(...y(4)),
      rising: x.every((v, k) => !k || v > x[k - 1]), first: x[0], last: x.at(-1), gaps: drawn.gap_count,
      gap: Array.from(drawn.gaps.subarray(0, 2)) });
    """
    got = node(code)
    assert got["rows"] <= 810
    assert got["held"] >= 600 * 30
    assert (got["most"], got["least"]) == (77, -55)
    assert got["rising"] and got["last"] == 0
    assert -603 < got["first"] <= -600
    assert got["gaps"] == 1
    assert got["gap"] == pytest.approx([-2999 / 30 - 0.0333, -2999 / 30], abs=1e-3)


def test_time_that_goes_back_leaves_the_old_on_the_strips():
    code = """
    import { CHANNELS, Ring } from "./ring.js";
    const ring = new Ring(), row = new Float64Array(CHANNELS.length);
    for (const t of [1, 2, 3, 3, 0.5, 0.6]) ring.add(t, 0, row);
    out([ring.rows, ring.last_s, ring.find(0.55)]);
    """
    assert node(code) == [2, 0.6, 1]


def test_a_figure_is_written_with_a_sign_that_is_not_true():
    code = """
    globalThis.document = {};
    const { clock, duration, signed, size, spread } = await import("./dom.js");
    out([signed(-0.001, 2), signed(-1.005, 1), signed(3, 0), spread(2.345), spread(123.4), duration(59.6),
      duration(61), clock(3725), clock(59.9), size(999), size(1.5e6)]);
    """
    assert node(code) == [
        "0.00", "−1.0", "+3", "2.35", "123", "60 s", "61 s", "1:02:05", "0:59", "999 B", "1.5 MB",
    ]  # fmt: skip
