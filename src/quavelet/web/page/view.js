// Where the viewer stands and how a point of the world falls on the picture; used by both ways of drawing the board.
// World and body are the program's: x east, y north, z up (azimuth arbitrary while yaw is relative), quaternions
// w x y z from body to world. Nothing here is y-up.

const ELEVATION = (27 * Math.PI) / 180;
const AZIMUTH = (24 * Math.PI) / 180; // behind the board's x, a little to its right
const REACH_X = 2.3; // half the width and height that must be seen, in cm
const REACH_Y = 1.62;
const LOWER = -0.08;
export const FIELD_DEG = 26;

/** Rows: to the right, up, and towards the viewer, each in the world. */
const { cos, sin } = Math;
export const RIGHT = [sin(AZIMUTH), -cos(AZIMUTH), 0];
export const UP = [cos(AZIMUTH) * sin(ELEVATION), sin(AZIMUTH) * sin(ELEVATION), cos(ELEVATION)];
export const BACK = [-cos(AZIMUTH) * cos(ELEVATION), -sin(AZIMUTH) * cos(ELEVATION), sin(ELEVATION)];
export const TARGET = [0, 0, LOWER];

const TAN = Math.tan((FIELD_DEG * Math.PI) / 360);

/** The picture: its size in px, the viewer's distance in cm, and px to a cm at the middle. */
export class View {
  constructor() {
    this.resize(300, 300);
  }

  /** @param {number} width @param {number} height */
  resize(width, height) {
    this.width = Math.max(1, width);
    this.height = Math.max(1, height);
    this.distance = Math.max(REACH_Y / TAN, (REACH_X * this.height) / this.width / TAN) + 0.7;
    this.focal_px = this.height / 2 / TAN;
    this.px_per_cm = this.focal_px / this.distance;
  }

  /** Where the point lies, in px from the picture's upper left. @param {number[]} out  x, y, and nearness */
  project(/** @type {number} */ x, /** @type {number} */ y, /** @type {number} */ z, out) {
    const dz = z - TARGET[2];
    const depth = BACK[0] * x + BACK[1] * y + BACK[2] * dz;
    const scale = this.focal_px / (this.distance - depth);
    out[0] = this.width / 2 + scale * (RIGHT[0] * x + RIGHT[1] * y + RIGHT[2] * dz);
    out[1] = this.height / 2 - scale * (UP[0] * x + UP[1] * y + UP[2] * dz);
    out[2] = depth;
  }
}

/** Rotation matrix, by rows, of the quaternion w x y z. @param {ArrayLike<number>} q @param {Float64Array} m */
export function matrixOf(q, m) {
  const w = q[0], x = q[1], y = q[2], z = q[3];
  m[0] = 1 - 2 * (y * y + z * z);
  m[1] = 2 * (x * y - w * z);
  m[2] = 2 * (x * z + w * y);
  m[3] = 2 * (x * y + w * z);
  m[4] = 1 - 2 * (x * x + z * z);
  m[5] = 2 * (y * z - w * x);
  m[6] = 2 * (x * z - w * y);
  m[7] = 2 * (y * z + w * x);
  m[8] = 1 - 2 * (x * x + y * y);
}

/** Quaternion w x y z, w >= 0, of the rotation matrix by rows (Shepperd). @param {Float64Array} m @param {Float64Array} q */
export function quaternionOf(m, q) {
  const four = [m[0] + m[4] + m[8], m[0] - m[4] - m[8], m[4] - m[0] - m[8], m[8] - m[0] - m[4]];
  const k = four.indexOf(Math.max(...four));
  const d = Math.sqrt(1 + four[k]) / 2;
  const e = 0.25 / d;
  const a = (m[7] - m[5]) * e, b = (m[2] - m[6]) * e, c = (m[3] - m[1]) * e;
  const xy = (m[1] + m[3]) * e, xz = (m[2] + m[6]) * e, yz = (m[5] + m[7]) * e;
  if (k === 0) set(q, d, a, b, c);
  else if (k === 1) set(q, a, d, xy, xz);
  else if (k === 2) set(q, b, xy, d, yz);
  else set(q, c, xz, yz, d);
}

/** @param {Float64Array} q */
function set(q, ...wxyz) {
  const sign = wxyz[0] < 0 ? -1 : 1;
  for (let k = 0; k < 4; k++) q[k] = sign * wxyz[k];
}
