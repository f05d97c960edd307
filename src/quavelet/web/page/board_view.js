// The picture of the board: draws when there is something new and somebody looks, by WebGL where it can, else by CSS;
// names the axes, and says in words how the board lies.

import { BoardPlain } from "./board_plain.js";
import { ARROW, UPRIGHT } from "./gy521.js";
import { byId, make, setText } from "./dom.js";
import { View, matrixOf } from "./view.js";

const TEXT_MS = 250;
const RING_LABEL = 2.13;
const TIPS = { X: [ARROW + 0.2, 0, 0.2], Y: [0, ARROW + 0.2, 0.2], Z: [0, 0, UPRIGHT + 0.3] };
const ROUND = {
  relative: ["0°", "90°", "180°", "−90°"],
  north: ["E", "N", "W", "S"],
};

export class BoardView {
  constructor() {
    this.place = byId("board");
    this.view = new View();
    this.q = new Float64Array([1, 0, 0, 0]);
    this.drawn = new Float64Array(4);
    this._m = new Float64Array(9);
    this._at = [0, 0, 0];
    this._count = 0;
    this._t_ns = 0;
    this._asked = 0;
    this._yaw = "relative";
    this._sigma_rad = 0;
    this._labels = Object.fromEntries([..."XYZ"].map((axis) => [axis, make("span", { class: `axis axis-${axis.toLowerCase()}` }, axis)]));
    this._round = ROUND.relative.map((text) => make("span", { class: "round" }, text));
    byId("board-labels").append(...this._round, ...Object.values(this._labels));
    setInterval(() => this._say(), TEXT_MS);
    this._plain();
    new ResizeObserver(() => this._resize()).observe(this.place);
    addEventListener("theme", () => (this.board.recolour(), this.again()));
    this._try();
  }

  /** @param {any} message  version 1 */
  show(message) {
    this.q.set(message.q);
    this._t_ns = message.t_ns;
    this._sigma_rad = (message.sigma_deg[2] * Math.PI) / 180;
    this._yaw = message.yaw;
    this._message = message;
    this.again();
  }

  /** Draw at the next frame; a page that nobody sees has none. */
  again() {
    if (!this._asked && this._message) this._asked = requestAnimationFrame(() => this._draw());
  }

  async _try() {
    if (location.hash === "#plain") return;
    const canvas = document.createElement("canvas");
    const context = canvas.getContext("webgl2", { alpha: true, antialias: true, powerPreference: "low-power" });
    if (!context) return;
    const { Board } = await import("./board.js");
    this.board.close();
    this._take(new Board(byId("board-scene"), canvas, context, () => this._plain()));
  }

  _plain() {
    this.board?.close();
    this._take(new BoardPlain(byId("board-scene")));
  }

  /** @param {any} board */
  _take(board) {
    this.board = board;
    this.place.dataset.kind = board.kind;
    this._resize();
  }

  _resize() {
    this.view.resize(this.place.clientWidth, this.place.clientHeight);
    this.board.resize(this.view);
    this.again();
  }

  _draw() {
    this._asked = 0;
    matrixOf(this.q, this._m);
    const m = this._m;
    // Where x points over the ground; straight up or down it points nowhere, and yaw's own figure has no meaning.
    const yaw_rad = Math.atan2(m[3], m[0]);
    this.board.draw(this.q, yaw_rad, this._sigma_rad, this.drawn);
    const data = this.place.dataset;
    const d = this.drawn;
    data.q = `${d[0].toFixed(9)},${d[1].toFixed(9)},${d[2].toFixed(9)},${d[3].toFixed(9)}`;
    data.tNs = String(this._t_ns);
    data.drawn = String(++this._count);
    for (const axis in this._labels) {
      const [x, y, z] = TIPS[/** @type {"X"|"Y"|"Z"} */ (axis)];
      this._put(this._labels[axis], m[0] * x + m[1] * y + m[2] * z, m[3] * x + m[4] * y + m[5] * z, m[6] * x + m[7] * y + m[8] * z);
    }
    const words = this._yaw === "relative" ? ROUND.relative : ROUND.north;
    for (let k = 0; k < 4; k++) {
      setText(this._round[k], words[k]);
      this._put(this._round[k], RING_LABEL * [1, 0, -1, 0][k], RING_LABEL * [0, 1, 0, -1][k], 0);
    }
    byId("board-labels").hidden = false;
    this.onDrawn?.(this._t_ns);
    this._unsaid = true;
  }

  /** @param {HTMLElement} label */
  _put(label, x, y, z) {
    this.view.project(x, y, z, this._at);
    label.style.transform = `translate(${this._at[0].toFixed(1)}px,${this._at[1].toFixed(1)}px) translate(-50%,-50%)`;
  }

  /** The same in words: how far each axis points up or down, which no choice of angles can garble. */
  _say() {
    if (!this._unsaid) return;
    this._unsaid = false;
    const up = (/** @type {number} */ k) => {
      const deg = Math.round((Math.asin(Math.max(-1, Math.min(1, this._m[6 + k]))) * 180) / Math.PI);
      return `${"XYZ"[k]} ${deg === 0 ? "level" : `${Math.abs(deg)}° ${deg > 0 ? "up" : "down"}`}`;
    };
    setText(byId("board-text"), `${up(0)}, ${up(1)}, ${up(2)}`);
  }
}
