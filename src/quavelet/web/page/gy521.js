// A GY-521 as one buys it, in cm: x away from the row of pins, y along it, z out of the side with the chip.

export const LONG = 2.12; // along y
export const WIDE = 1.64; // along x
export const THICK = 0.16;
export const ARROW = 1.42; // x and y, from the middle; UPRIGHT is z's
export const UPRIGHT = 1.05;
export const PINS = ["VCC", "GND", "SCL", "SDA", "XDA", "XCL", "AD0", "INT"];
export const PITCH = 0.254;
export const PINS_X = -0.68;

/** Parts on top: x, y, length along x, along y, height, colour. */
export const PARTS = [
  [0.1, 0.0, 0.4, 0.4, 0.1, 0x1b1d20],
  [-0.02, 0.72, 0.17, 0.3, 0.12, 0x26282c],
  [0.36, 0.62, 0.1, 0.18, 0.07, 0xb8926a],
  [-0.3, 0.34, 0.18, 0.1, 0.07, 0xb8926a],
  [0.46, -0.2, 0.16, 0.09, 0.06, 0x2b2d31],
  [0.46, 0.12, 0.16, 0.09, 0.06, 0x2b2d31],
  [-0.3, -0.36, 0.18, 0.1, 0.07, 0xb8926a],
  [-0.3, -0.62, 0.16, 0.09, 0.06, 0x2b2d31],
  [0.1, -0.5, 0.2, 0.1, 0.07, 0xb8926a],
];

const PX = 300; // to a cm

/** The upper side, drawn: to the right is -y, upwards is x. @returns {HTMLCanvasElement} */
export function silkScreen() {
  const canvas = document.createElement("canvas");
  canvas.width = LONG * PX;
  canvas.height = WIDE * PX;
  const c = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  const right = (/** @type {number} */ y) => (LONG / 2 - y) * PX;
  const down = (/** @type {number} */ x) => (WIDE / 2 - x) * PX;
  ground(c, canvas.width, canvas.height);
  for (const y of [0.86, -0.86]) ring(c, right(y), down(0.62), 0.2 * PX, 0.145 * PX);
  c.font = `600 ${0.115 * PX}px system-ui, sans-serif`;
  c.textBaseline = "middle";
  PINS.forEach((name, k) => {
    const at = right((3.5 - k) * PITCH);
    ring(c, at, down(PINS_X), 0.085 * PX, 0.045 * PX);
    c.save();
    c.translate(at, down(PINS_X + 0.13));
    c.rotate(-Math.PI / 2);
    c.fillStyle = "#eef4ff";
    c.fillText(name, 0, 0);
    c.restore();
  });
  c.strokeStyle = c.fillStyle = "#eef4ff";
  c.lineWidth = 4;
  for (const [x, y, a, b] of PARTS) c.strokeRect(right(y + b / 2) - 7, down(x + a / 2) - 7, b * PX + 14, a * PX + 14);
  c.beginPath();
  c.arc(right(0.27), down(0.37), 6, 0, 7);
  c.fill();
  c.textAlign = "center";
  c.fillText("GY-521", right(-0.36), down(0.68));
  arrow(c, right(-0.76), down(0.02), 0, -0.3 * PX);
  c.fillText("X", right(-0.76), down(0.42));
  arrow(c, right(-0.76), down(0.02), -0.22 * PX, 0);
  c.fillText("Y", right(-0.46), down(0.02));
  return canvas;
}

/** @param {CanvasRenderingContext2D} c @param {number} width @param {number} height */
function ground(c, width, height) {
  const shade = c.createLinearGradient(0, 0, width, height);
  shade.addColorStop(0, "#1d5fc4");
  shade.addColorStop(1, "#15479a");
  c.fillStyle = shade;
  c.fillRect(0, 0, width, height);
  c.strokeStyle = "rgba(120, 170, 255, .28)";
  c.lineWidth = 5;
  c.lineJoin = "round";
  const traces = [
    [0.2, 0.86, 0.2, 0.5, 0.34, 0.36],
    [0.32, 0.86, 0.32, 0.62, 0.43, 0.52],
    [0.44, 0.86, 0.44, 0.58],
    [0.56, 0.86, 0.56, 0.6, 0.53, 0.55],
    [0.68, 0.86, 0.68, 0.62, 0.6, 0.5],
    [0.8, 0.86, 0.8, 0.5, 0.62, 0.4],
    [0.3, 0.3, 0.42, 0.36],
    [0.62, 0.3, 0.74, 0.2],
  ];
  for (const [x, y, ...rest] of traces) {
    c.beginPath();
    c.moveTo(x * width, y * height);
    for (let k = 0; k < rest.length; k += 2) c.lineTo(rest[k] * width, rest[k + 1] * height);
    c.stroke();
  }
}

/** @param {CanvasRenderingContext2D} c */
function ring(c, /** @type {number} */ x, /** @type {number} */ y, /** @type {number} */ outer, /** @type {number} */ inner) {
  c.fillStyle = "#e3bf63";
  c.beginPath();
  c.arc(x, y, outer, 0, 7);
  c.fill();
  c.fillStyle = "#0e1a2c";
  c.beginPath();
  c.arc(x, y, inner, 0, 7);
  c.fill();
}

/** @param {CanvasRenderingContext2D} c */
function arrow(c, /** @type {number} */ x, /** @type {number} */ y, /** @type {number} */ dx, /** @type {number} */ dy) {
  const length = Math.hypot(dx, dy);
  const ux = dx / length, uy = dy / length;
  c.lineWidth = 5;
  c.beginPath();
  c.moveTo(x, y);
  c.lineTo(x + dx, y + dy);
  c.lineTo(x + dx - 15 * ux + 9 * uy, y + dy - 15 * uy - 9 * ux);
  c.moveTo(x + dx, y + dy);
  c.lineTo(x + dx - 15 * ux - 9 * uy, y + dy - 15 * uy + 9 * ux);
  c.stroke();
}
