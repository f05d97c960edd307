// Roll, pitch, yaw with one sigma each, rates, force and bias as figures.

import { byId, setText, signed, spread } from "./dom.js";

const DEG = 180 / Math.PI;
const EVERY_MS = 100; // faster than that no eye reads a figure
const ANGLES = ["roll", "pitch", "yaw"];
const SAID_MS = 4000;
const KIND = { relative: "relative", magnetic: "from magnetic north", true: "from true north" };

export class Numbers {
  /** @param {(text: string) => void} polite */
  constructor(polite) {
    this._polite = polite;
    this._drawn_ms = -EVERY_MS;
    this._asked = 0;
    this._still = /** @type {boolean|null} */ (null);
    this._said = /** @type {boolean|null} */ (null);
    this._since_ms = 0;
    this._parts = ANGLES.map((name) => ({
      value: byId(name), sigma: byId(`${name}-sigma`), mark: byId(`${name}-mark`), band: byId(`${name}-band`),
    }));
    this._cells = ["rate", "force", "bias"].map((row) => [..."xyz"].map((axis) => byId(`${row}-${axis}`)));
  }

  /** @param {any} message  version 1 */
  show(message) {
    this._message = message;
    if (!this._asked) this._asked = requestAnimationFrame((now_ms) => this._draw(now_ms));
  }

  /** @param {number} now_ms */
  _draw(now_ms) {
    this._asked = 0;
    const m = this._message;
    if (now_ms - this._drawn_ms < EVERY_MS) return this.show(m);
    this._drawn_ms = now_ms;
    const angles = [m.roll_deg, m.pitch_deg, m.yaw_deg];
    this._parts.forEach((part, k) => {
      setText(part.value, signed(angles[k], 2));
      setText(part.sigma, spread(m.sigma_deg[k]));
      part.mark.style.left = `${50 + angles[k] / 3.6}%`;
      part.band.style.left = `${50 + angles[k] / 3.6}%`;
      part.band.style.width = `${Math.min(100, m.sigma_deg[k] / 1.8)}%`;
    });
    for (let k = 0; k < 3; k++) {
      setText(this._cells[0][k], signed(m.gyro_rad_s[k] * DEG, 2));
      setText(this._cells[1][k], signed(m.accel_m_s2[k], 2));
      setText(this._cells[2][k], signed(m.gyro_bias_rad_s[k] * DEG, 3));
    }
    const relative = m.yaw === "relative";
    byId("yaw-tile").classList.toggle("relative", relative);
    setText(byId("yaw-kind"), KIND[/** @type {keyof KIND} */ (m.yaw)] ?? m.yaw);
    byId("yaw-note").hidden = !relative;
    setText(byId("yaw-key"), relative ? "yaw, relative" : "yaw");
    byId("yaw-key").classList.toggle("dashed", relative);
    const flags = byId("flags");
    flags.hidden = !m.flags.length;
    if (m.flags.length) setText(flags, `flagged: ${m.flags.join(", ")}`);
    this._motion(m.still, now_ms);
  }

  /** @param {boolean} still @param {number} now_ms */
  _motion(still, now_ms) {
    if (still !== this._still) {
      this._still = still;
      this._since_ms = now_ms;
      setText(byId("motion-text"), still ? "still" : "moving");
      byId("motion").dataset.level = still ? "good" : "move";
    }
    if (still !== this._said && now_ms - this._since_ms > SAID_MS) {
      if (this._said !== null) this._polite(still ? "The board is still." : "The board is moving.");
      this._said = still;
    }
  }
}
