// Angles, rates and temperature over the last 10 s to 10 min. Where samples are missing the line breaks, over a band.

import uPlot from "./vendor/uplot.min.js";
import { byId, colour, make, signed } from "./dom.js";
import { CHANNELS, Drawn, Ring } from "./ring.js";

const SPANS_S = [10, 30, 60, 300, 600];
const NAMES = ["10 s", "30 s", "1 min", "5 min", "10 min"];
const KEY = "quavelet.span";
const EVERY_MS = 100;
const SAID_MS = 2000;
const BREAK_S = 0.5;
const DASH = [5, 4];
const DEG = 180 / Math.PI;
const CHARTS = [
  { id: "strip-angles", what: "angles", unit: "°", from: 0, names: ["roll", "pitch", "yaw"], axes: "xyz", least: 10, round: 360, digits: 1 },
  { id: "strip-rates", what: "rates", unit: "°/s", from: 3, names: ["x", "y", "z"], axes: "xyz", least: 4, round: 0, digits: 1 },
  { id: "strip-temp", what: "temperature", unit: "°C", from: 6, names: ["chip"], axes: "t", least: 1, round: 0, digits: 1 },
];

export class Strips {
  constructor() {
    this.ring = new Ring();
    this._drawn = new Drawn(1200);
    this._row = new Float64Array(CHANNELS.length);
    this._span_s = this._kept();
    this._seen_ms = 0;
    this._drawn_ms = 0;
    this._said_ms = 0;
    this._relative = true;
    /** What stands at the right: the newest sample, and while nothing comes the time goes on without it. */
    this.running = true;
    this._spans();
    this._charts = CHARTS.map((about) => ({ about, plot: this._chart(about), place: byId(about.id) }));
    this._shown = true;
    new IntersectionObserver((entries) => (this._shown = entries.some((e) => e.isIntersecting))).observe(byId("strip-angles").closest(".card"));
    new ResizeObserver(() => this._resize()).observe(byId("strip-angles"));
    addEventListener("theme", () => this._recolour());
    const tick = (now_ms) => {
      if (this._shown && now_ms - this._drawn_ms >= EVERY_MS - 4) this._draw(now_ms);
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  /** @param {any} m  message version 1 */
  add(m) {
    const row = this._row;
    row[0] = m.roll_deg;
    row[1] = m.pitch_deg;
    row[2] = m.yaw_deg;
    for (let k = 0; k < 3; k++) row[3 + k] = m.gyro_rad_s[k] * DEG;
    row[6] = m.temp_degc;
    this._relative = m.yaw === "relative";
    this.ring.add(m.t_ns / 1e9, m.gap_ns / 1e9, row);
    this._seen_ms = performance.now();
    this._new = true;
  }

  /** All that is held, anew. @param {any} history */
  replace(history) {
    this.ring.clear();
    for (let k = 0; k < history.t_ns.length; k++) {
      CHANNELS.forEach((name, c) => (this._row[c] = history[name][k]));
      this.ring.add(history.t_ns[k] / 1e9, history.gap_ns[k] / 1e9, this._row);
    }
    this._seen_ms = performance.now();
    this._new = true;
  }

  /** @param {number} now_ms */
  _draw(now_ms) {
    const silent_s = this.running ? (now_ms - this._seen_ms) / 1000 : 0;
    const waiting = silent_s > BREAK_S;
    if (!this.ring.rows || (!this._new && !waiting)) return;
    this._new = false;
    this._drawn_ms = now_ms;
    const to_s = this.ring.last_s + (waiting ? silent_s : 0);
    const drawn = this._drawn;
    drawn.take(this.ring, to_s - this._span_s, to_s, this._columns);
    if (waiting && 2 * drawn.gap_count + 2 <= drawn.gaps.length) {
      drawn.gaps[2 * drawn.gap_count] = -silent_s;
      drawn.gaps[2 * drawn.gap_count++ + 1] = 0;
    }
    const x = drawn.x.subarray(0, drawn.rows);
    this._charts[0].plot.series[3].dash = this._relative ? DASH : undefined;
    for (const { about, plot } of this._charts) {
      const data = [x];
      for (let k = 0; k < about.names.length; k++) data.push(drawn.y[about.from + k].subarray(0, drawn.rows));
      plot.setData(data, false);
      const [least, most] = range(data, about.least, -this._span_s);
      plot.batch(() => {
        plot.setScale("x", { min: -this._span_s, max: 0 });
        plot.setScale("y", { min: least, max: most });
      });
      if (now_ms - this._said_ms > SAID_MS) this._say(about, data);
    }
    if (now_ms - this._said_ms > SAID_MS) this._said_ms = now_ms;
  }

  /** The picture's words. @param {any} about @param {any[]} data */
  _say(about, data) {
    const words = about.names.map((name, k) => {
      const [least, most] = range([data[0], data[k + 1]], 0, -this._span_s, true);
      return `${name} ${signed(least, about.digits)} to ${signed(most, about.digits)}${about.unit}`;
    });
    const span = NAMES[SPANS_S.indexOf(this._span_s)];
    const gaps = this._drawn.gap_count ? `, ${this._drawn.gap_count} gaps` : "";
    byId(about.id).querySelector(".plot")?.setAttribute("aria-label", `${about.what} over the last ${span}: ${words.join(", ")}${gaps}`);
  }

  /** @param {any} about */
  _chart(about) {
    const place = /** @type {HTMLElement} */ (byId(about.id).querySelector(".plot"));
    place.setAttribute("role", "img");
    place.setAttribute("aria-label", about.what);
    const line = (/** @type {number} */ k) => ({
      label: about.names[k],
      stroke: () => colour(`--${about.axes[k]}`),
      width: 1.6,
      points: { show: false },
      gaps: (/** @type {any} */ u, /** @type {number} */ series, /** @type {number} */ from, /** @type {number} */ to) => this._breaks(u, series, from, to, about.round),
    });
    const axis = (/** @type {object} */ more) => ({
      stroke: () => colour("--quiet"), font: "12px system-ui, sans-serif", ticks: { show: false },
      grid: { stroke: () => colour("--line"), width: 1 }, ...more,
    });
    const last = about.id === "strip-temp";
    const plot = new uPlot(
      {
        width: 600,
        height: this._height(about),
        legend: { show: false },
        cursor: { show: false },
        select: { show: false, left: 0, top: 0, width: 0, height: 0 },
        padding: [6, 16, 0, 0],
        scales: { x: { time: false, auto: false, range: (_u, least, most) => [least, most] }, y: { auto: false, range: (_u, least, most) => [least, most] } },
        axes: [
          axis({ size: last ? 26 : 8, gap: 4, values: last ? (_u, at) => at.map(ago) : (_u, at) => at.map(() => ""), space: 64, incrs: [1, 2, 5, 10, 15, 30, 60, 120] }),
          axis({ size: 46, gap: 6, space: 26, values: (_u, at, _a, _s, step) => at.map((v) => (v < 0 ? "−" : "") + Math.abs(v).toFixed(step < 0.1 ? 2 : step % 1 ? 1 : 0)) }),
        ],
        series: [{}, ...about.names.map((_, k) => line(k))],
        hooks: { drawClear: [(u) => this._bands(u)] },
      },
      [[], ...about.names.map(() => [])],
      place,
    );
    return plot;
  }

  /** Parts of a line that are not drawn: where samples are missing, and where an angle goes round. */
  _breaks(u, series, from, to, round) {
    const x = u.data[0], y = u.data[series];
    const breaks = [];
    const px = (/** @type {number} */ v) => Math.round(u.valToPos(v, "x", true));
    let gap = 0;
    const { gaps, gap_count } = this._drawn;
    for (let k = Math.max(1, from); k <= to; k++) {
      while (gap < gap_count && gaps[2 * gap + 1] < x[k] - 1e-9) gap++;
      const missing = gap < gap_count && gaps[2 * gap] >= x[k - 1] - 1e-9 && gaps[2 * gap + 1] <= x[k] + 1e-9;
      if (missing || x[k] - x[k - 1] > Math.max(BREAK_S, this._span_s / 100) || (round && Math.abs(y[k] - y[k - 1]) > round / 2)) breaks.push([px(x[k - 1]), px(x[k])]);
    }
    return breaks;
  }

  /** @param {any} u */
  _bands(u) {
    const c = u.ctx;
    const { left, top, width, height } = u.bbox;
    c.save();
    c.beginPath();
    c.rect(left, top, width, height);
    c.clip();
    c.fillStyle = colour("--gap");
    for (let k = 0; k < this._drawn.gap_count; k++) {
      const from = u.valToPos(Math.max(-this._span_s, this._drawn.gaps[2 * k]), "x", true);
      const to = u.valToPos(this._drawn.gaps[2 * k + 1], "x", true);
      c.fillRect(from, top, Math.max(2 * devicePixelRatio, to - from), height);
    }
    c.restore();
  }

  _spans() {
    const place = byId("spans");
    SPANS_S.forEach((span_s, k) => {
      const input = /** @type {HTMLInputElement} */ (make("input", { type: "radio", name: "span", id: `span-${span_s}`, value: span_s }));
      input.checked = span_s === this._span_s;
      input.addEventListener("change", () => {
        this._span_s = span_s;
        this._new = true;
        try {
          localStorage.setItem(KEY, String(span_s));
        } catch {
          // storage may be forbidden
        }
      });
      place.append(input, make("label", { for: `span-${span_s}` }, NAMES[k]));
    });
  }

  _kept() {
    try {
      const span_s = Number(localStorage.getItem(KEY));
      return SPANS_S.includes(span_s) ? span_s : 30;
    } catch {
      return 30;
    }
  }

  /** @param {any} about */
  _height(about) {
    const tall = innerHeight > 1000 ? 1.25 : 1;
    return Math.round((about.id === "strip-temp" ? 88 : about.id === "strip-rates" ? 112 : 150) * tall);
  }

  _resize() {
    const width = byId("strip-angles").clientWidth;
    this._columns = Math.max(100, Math.round(width / 2));
    for (const { about, plot } of this._charts) plot.setSize({ width, height: this._height(about) });
    this._new = true;
  }

  _recolour() {
    for (const { plot } of this._charts) plot.redraw(false, true);
  }
}

/** Round bounds of all series from `from_s` on, at least `least` high. */
function range(data, least, from_s, exact = false) {
  let low = Infinity, high = -Infinity;
  for (let s = 1; s < data.length; s++) {
    for (let k = 0; k < data[0].length; k++) {
      if (data[0][k] < from_s) continue;
      const v = data[s][k];
      if (v < low) low = v;
      if (v > high) high = v;
    }
  }
  if (low > high) return [-least / 2 || 0, least / 2 || 0];
  if (exact) return [low, high];
  const middle = (low + high) / 2;
  const half = Math.max(least / 2, (high - low) * 0.56);
  const step = 10 ** Math.floor(Math.log10(half)) / 2;
  return [Math.floor((middle - half) / step) * step, Math.ceil((middle + half) / step) * step];
}

/** @param {number} t_s  0 and below */
function ago(t_s) {
  if (t_s === 0) return "now";
  return t_s <= -60 && t_s % 60 === 0 ? `−${-t_s / 60} min` : `−${-t_s} s`;
}
