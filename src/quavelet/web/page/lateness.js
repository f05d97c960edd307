// How late the loop woke, as a histogram over a logarithmic scale; and how old what is drawn is.

import { byId, colour, setText } from "./dom.js";

const KEPT = 300;

export class Lateness {
  constructor() {
    this._canvas = /** @type {HTMLCanvasElement} */ (byId("lateness"));
    this._ages_ms = new Float32Array(KEPT);
    this._sorted = new Float32Array(KEPT);
    this._count = 0;
    addEventListener("theme", () => this._draw());
    new ResizeObserver(() => this._draw()).observe(this._canvas);
  }

  /** @param {any} frame  status */
  show(frame) {
    this._lateness = frame.lateness;
    const loop = frame.s.loop;
    this._canvas.closest("section")?.toggleAttribute("hidden", !loop.ticks); // a player has no deadlines
    setText(
      byId("lateness-text"),
      `half within ${us(loop.lateness_p50_ns / 1e3)}, 99 % within ${us(loop.lateness_p99_ns / 1e3)}, latest ${us(loop.lateness_max_ns / 1e3)}; ` +
        `${loop.missed} of ${loop.ticks + loop.missed} deadlines missed`,
    );
    if (this._count) {
      const n = Math.min(KEPT, this._count);
      this._sorted.set(this._ages_ms);
      this._sorted.subarray(0, n).sort();
      setText(byId("latency-text"), `When it is drawn here, a sample is ${Math.round(this._sorted[n >> 1])} ms old (median), 99 % within ${Math.round(this._sorted[Math.floor(0.99 * n)])} ms.`);
    }
    this._draw();
  }

  /** @param {number} age_ms  of the sample as it was drawn */
  drawn(age_ms) {
    if (Math.abs(age_ms) < 5000) this._ages_ms[this._count++ % KEPT] = age_ms;
  }

  _draw() {
    const canvas = this._canvas;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width || !this._lateness || document.hidden) return;
    const scale = devicePixelRatio;
    if (canvas.width !== Math.round(width * scale)) {
      canvas.width = Math.round(width * scale);
      canvas.height = Math.round(height * scale);
    }
    const c = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
    c.setTransform(scale, 0, 0, scale, 0, 0);
    c.clearRect(0, 0, width, height);
    const { edges_us, counts } = this._lateness;
    const low = 0, high = Math.max(5, Math.ceil(Math.log10(Math.max(1, ...edges_us))));
    const x = (/** @type {number} */ edge_us) => (width * (Math.log10(Math.max(1, edge_us)) - low)) / (high - low);
    const foot = height - 18;
    c.font = "11px system-ui, sans-serif";
    c.textBaseline = "bottom";
    c.fillStyle = colour("--quiet");
    c.strokeStyle = colour("--line");
    c.textAlign = "center";
    for (let k = 1; k < high; k++) {
      const at = Math.round(x(10 ** k)) + 0.5;
      c.beginPath();
      c.moveTo(at, 0);
      c.lineTo(at, foot);
      c.stroke();
      c.fillText(us(10 ** k), at, height);
    }
    // The square root keeps the few late ones to be seen beside the many that are in time.
    const most = Math.sqrt(Math.max(1, ...counts));
    c.fillStyle = colour("--accent");
    counts.forEach((/** @type {number} */ count, /** @type {number} */ k) => {
      if (!count) return;
      const from = x(edges_us[k]), to = x(edges_us[k + 1] ?? edges_us[k] * 1.12);
      const tall = Math.max(2, ((foot - 4) * Math.sqrt(count)) / most);
      c.fillRect(from + 0.5, foot - tall, Math.max(1, to - from - 1), tall);
    });
    c.fillStyle = colour("--line-strong");
    c.fillRect(0, foot, width, 1);
  }
}

/** @param {number} value_us */
function us(value_us) {
  if (value_us < 1000) return `${Math.round(value_us)} µs`;
  return value_us < 1e6 ? `${(value_us / 1000).toFixed(value_us < 9950 && value_us % 1000 ? 1 : 0)} ms` : `${(value_us / 1e6).toFixed(1)} s`;
}
