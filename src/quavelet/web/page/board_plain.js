// The board without WebGL: boxes placed by CSS 3D transforms, turned to the same orientation.

import { ARROW, LONG, PARTS, PINS, PINS_X, PITCH, THICK, UPRIGHT, WIDE, silkScreen } from "./gy521.js";
import { BACK, RIGHT, TARGET, UP, matrixOf, quaternionOf } from "./view.js";
import { make } from "./dom.js";

// CSS counts x to the right, y down and z towards the viewer. The camera's rows take the world there, and a face of
// the board has -y to its right and -x downwards; each of the two is a mirror, both together none.
const CAMERA = [...RIGHT, ...UP.map((u) => -u), ...BACK];
const FACE = [0, -1, 0, -1, 0, 0, 0, 0, 1];
const UNIT = 100; // px to a cm on the board itself; what is seen is scaled once

export class BoardPlain {
  /** @param {HTMLElement} place */
  constructor(place) {
    this.kind = "plain";
    this.turned = make("div", { class: "plain-board" });
    this.ground = make("div", { class: "plain-ground" });
    this.ring = make("div", { class: "plain-ring" });
    this.room = make("div", { class: "plain-room" }, this.ground, this.ring, this.turned);
    place.append(this.room);
    theBoard(this.turned);
    this._r = new Float64Array(9);
    this._m = new Float64Array(9);
    this._s = 1;
  }

  /** @param {import("./view.js").View} view */
  resize(view) {
    this._s = view.px_per_cm / UNIT;
    this.room.style.perspective = `${view.focal_px}px`;
    matrixOf([1, 0, 0, 0], this._r);
    this.ground.style.transform = this._css(this._r, -1.15);
    this.ring.style.transform = this._css(this._r, 0);
  }

  /**
   * As `Board.draw`; yaw and its sigma stand beside the board as figures only.
   * @param {ArrayLike<number>} q @param {number} _yaw_rad @param {number} _sigma_rad @param {Float64Array} drawn
   */
  draw(q, _yaw_rad, _sigma_rad, drawn) {
    matrixOf(q, this._r);
    this.turned.style.transform = this._css(this._r, 0);
    const seen = new DOMMatrixReadOnly(getComputedStyle(this.turned).transform);
    // By rows, as it stands in the page; undone: world = camera^T seen face^T / scale
    const m = [seen.m11, seen.m21, seen.m31, seen.m12, seen.m22, seen.m32, seen.m13, seen.m23, seen.m33];
    const world = product(product(transposed(CAMERA), m), transposed(FACE));
    for (let k = 0; k < 9; k++) this._m[k] = world[k] / this._s;
    quaternionOf(this._m, drawn);
  }

  recolour() {}

  close() {
    this.room.remove();
  }

  /** @param {ArrayLike<number>} r @param {number} z_cm */
  _css(r, z_cm) {
    const m = product(product(CAMERA, r), FACE);
    const s = this._s;
    const up = (z_cm - TARGET[2]) * s * UNIT;
    const at = [CAMERA[2] * up, CAMERA[5] * up, CAMERA[8] * up];
    const column = (/** @type {number} */ k) => [m[k], m[k + 3], m[k + 6]].map((v) => (v * s).toFixed(9)).join(",");
    return `matrix3d(${column(0)},0,${column(1)},0,${column(2)},0,${at.map((v) => v.toFixed(4)).join(",")},1)`;
  }
}

/** @param {ArrayLike<number>} a @param {ArrayLike<number>} b */
function product(a, b) {
  const c = new Array(9);
  for (let i = 0; i < 3; i++) {
    for (let j = 0; j < 3; j++) c[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
  }
  return c;
}

/** @param {ArrayLike<number>} a */
const transposed = (a) => [a[0], a[3], a[6], a[1], a[4], a[7], a[2], a[5], a[8]];

/** @param {HTMLElement} board */
function theBoard(board) {
  box(board, 0, 0, 0, WIDE, LONG, THICK, "pcb");
  const top = silkScreen();
  top.className = "plain-top";
  size(top, LONG, WIDE);
  top.style.transform = `translateZ(${(THICK / 2) * UNIT + 0.5}px)`;
  board.append(top);
  for (const [x, y, a, b, c] of PARTS) box(board, x, y, THICK / 2 + c / 2, a, b, c, "part");
  box(board, PINS_X, 0, -THICK / 2 - 0.125, 0.25, PINS.length * PITCH, 0.25, "part");
  for (let k = 0; k < PINS.length; k++) box(board, PINS_X, (3.5 - k) * PITCH, -0.5, 0.06, 0.06, 0.5, "gold");
  arrow(board, "x", 0.2, ARROW, "rotateZ(-90deg)");
  arrow(board, "y", 0.2, ARROW, "rotateZ(180deg)");
  arrow(board, "z", THICK / 2, UPRIGHT, "rotateY(-90deg)");
}

/** Two flat arrows across each other, from `z` over the board's middle. */
function arrow(board, axis, z, length, turn) {
  for (const about of [0, 90]) {
    const flat = make("div", { class: `plain-arrow ${axis}` });
    flat.style.width = `${length * UNIT}px`;
    flat.style.height = "18px";
    flat.style.top = "-9px";
    flat.style.transformOrigin = "0 50%";
    flat.style.transform = `translateZ(${z * UNIT}px) ${turn} rotateX(${about}deg)`;
    board.append(flat);
  }
}

/** @param {HTMLElement} element @param {number} width @param {number} height */
function size(element, width, height) {
  element.style.width = `${width * UNIT}px`;
  element.style.height = `${height * UNIT}px`;
  element.style.left = `${(-width / 2) * UNIT}px`;
  element.style.top = `${(-height / 2) * UNIT}px`;
}

/** Six faces of a box whose middle is at x y z, of lengths a b c along them. */
function box(board, x, y, z, a, b, c, name) {
  const faces = [
    [b, a, `translateZ(${(c / 2) * UNIT}px)`, "top"],
    [b, a, `rotateY(180deg) translateZ(${(c / 2) * UNIT}px)`, "bottom"],
    [b, c, `rotateX(90deg) translateZ(${(a / 2) * UNIT}px)`, "front"],
    [b, c, `rotateX(-90deg) translateZ(${(a / 2) * UNIT}px)`, "back"],
    [c, a, `rotateY(90deg) translateZ(${(b / 2) * UNIT}px)`, "side"],
    [c, a, `rotateY(-90deg) translateZ(${(b / 2) * UNIT}px)`, "side"],
  ];
  for (const [width, height, turn, which] of faces) {
    const face = make("div", { class: `plain-face ${name}-${which}` });
    size(face, /** @type {number} */ (width), /** @type {number} */ (height));
    face.style.transform = `translate3d(${-y * UNIT}px,${-x * UNIT}px,${z * UNIT}px) ${turn}`;
    board.append(face);
  }
}
