// The board with three.js. The scene is z up as the world is: only the camera is told, and no quaternion is converted.

import {
  BoxGeometry, BufferAttribute, BufferGeometry, CanvasTexture, ConeGeometry, CylinderGeometry, DirectionalLight,
  DoubleSide, Group, HemisphereLight, LineBasicMaterial, LineSegments, Matrix4, Mesh, MeshBasicMaterial,
  MeshStandardMaterial, PerspectiveCamera, PlaneGeometry, Quaternion, SRGBColorSpace, Scene, Vector3, WebGLRenderer,
} from "./vendor/three.min.js";
import { ARROW, LONG, PARTS, PINS, PINS_X, PITCH, THICK, UPRIGHT, WIDE, silkScreen } from "./gy521.js";
import { BACK, FIELD_DEG, TARGET } from "./view.js";
import { colour } from "./dom.js";

const GROUND_Z = -1.15;
export const RING = 1.95;
const WEDGE = 48;

export class Board {
  /** @param {HTMLElement} place @param {WebGL2RenderingContext} context @param {() => void} lost  it was */
  constructor(place, canvas, context, lost) {
    this.kind = "webgl";
    this.renderer = new WebGLRenderer({ canvas, context, alpha: true });
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      lost();
    });
    place.append(canvas);
    this.camera = new PerspectiveCamera(FIELD_DEG, 1, 0.5, 60);
    this.camera.up.set(0, 0, 1);
    this.scene = new Scene();
    this._light();
    this.board = theBoard();
    this.scene.add(this.board);
    this._surroundings();
    this._read = new Quaternion();
    this._flat = new Matrix4();
    this._ahead = new Vector3();
    this.recolour();
  }

  /** @param {import("./view.js").View} view */
  resize(view) {
    this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.renderer.setSize(view.width, view.height);
    this.camera.aspect = view.width / view.height;
    this.camera.position.set(...BACK).multiplyScalar(view.distance).add(new Vector3(...TARGET));
    this.camera.lookAt(new Vector3(...TARGET));
    this.camera.updateProjectionMatrix();
  }

  /**
   * Draw the board so; `drawn` gets w x y z as read back from what was drawn.
   * @param {ArrayLike<number>} q @param {number} yaw_rad @param {number} sigma_rad @param {Float64Array} drawn
   */
  draw(q, yaw_rad, sigma_rad, drawn) {
    this.board.quaternion.set(q[1], q[2], q[3], q[0]);
    this.board.updateMatrixWorld(true);
    this.shadow.matrix.multiplyMatrices(this._flat.set(1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, GROUND_Z + 0.01, 0, 0, 0, 1), this.board.matrixWorld);
    this._wedge(yaw_rad, Math.min(Math.PI, Math.max(sigma_rad, 0.004)));
    this.renderer.render(this.scene, this.camera);
    const r = this._read.setFromRotationMatrix(this.board.matrixWorld);
    const sign = r.w < 0 ? -1 : 1;
    drawn[0] = sign * r.w;
    drawn[1] = sign * r.x;
    drawn[2] = sign * r.y;
    drawn[3] = sign * r.z;
  }

  /** Take the colours of the style sheet, after they changed. */
  recolour() {
    this.grid.material.color.set(colour("--scene-grid"));
    this.ring.material.color.set(colour("--scene-ring"));
    this.shadow.material.opacity = Number(colour("--scene-shadow"));
    this.wedge.material.color.set(colour("--z"));
    this.needle.material.color.set(colour("--z"));
    for (const axis of "xyz") this.board.getObjectByName(axis)?.traverse((/** @type {any} */ o) => o.material?.color.set(colour(`--scene-${axis}`)));
  }

  close() {
    this.renderer.domElement.remove();
    this.renderer.dispose();
  }

  _light() {
    const sky = new HemisphereLight(0xffffff, 0x6b7687, 2.1);
    sky.position.set(0, 0, 1);
    const sun = new DirectionalLight(0xfff4e2, 2.4);
    sun.position.set(-2.5, 3, 5);
    this.scene.add(sky, sun);
  }

  _surroundings() {
    this.grid = grid();
    this.ring = horizon();
    this.shadow = new Mesh(
      new PlaneGeometry(WIDE, LONG),
      new MeshBasicMaterial({ color: 0x000000, transparent: true, opacity: 0.2, side: DoubleSide, depthWrite: false }),
    );
    this.shadow.matrixAutoUpdate = false;
    const fan = new BufferGeometry();
    fan.setAttribute("position", new BufferAttribute(new Float32Array(6 * (WEDGE + 1)), 3));
    fan.setIndex(Array.from({ length: WEDGE }, (_, k) => [2 * k, 2 * k + 1, 2 * k + 2, 2 * k + 1, 2 * k + 3, 2 * k + 2]).flat());
    this.wedge = new Mesh(fan, new MeshBasicMaterial({ transparent: true, opacity: 0.38, side: DoubleSide, depthWrite: false }));
    this.wedge.frustumCulled = false;
    this.needle = new Mesh(new ConeGeometry(0.1, 0.26, 3), new MeshBasicMaterial());
    this.needle.scale.z = 0.3;
    this.scene.add(this.grid, this.ring, this.shadow, this.wedge, this.needle);
  }

  /** Where x points over the ground, with one sigma of yaw to both sides, on the horizon. */
  _wedge(/** @type {number} */ yaw, /** @type {number} */ sigma) {
    const place = this.wedge.geometry.attributes.position;
    for (let k = 0; k <= WEDGE; k++) {
      const a = yaw + sigma * ((2 * k) / WEDGE - 1);
      const c = Math.cos(a), s = Math.sin(a);
      place.setXYZ(2 * k, (RING - 0.17) * c, (RING - 0.17) * s, 0);
      place.setXYZ(2 * k + 1, (RING - 0.01) * c, (RING - 0.01) * s, 0);
    }
    place.needsUpdate = true;
    this.needle.position.set((RING - 0.13) * Math.cos(yaw), (RING - 0.13) * Math.sin(yaw), 0);
    this.needle.rotation.set(0, 0, yaw - Math.PI / 2);
  }
}

function theBoard() {
  const board = new Group();
  const box = (x, y, z, a, b, c, paint) => {
    const mesh = new Mesh(new BoxGeometry(a, b, c), paint);
    mesh.position.set(x, y, z);
    board.add(mesh);
  };
  const paint = (color, roughness = 0.6, metalness = 0) => new MeshStandardMaterial({ color, roughness, metalness });
  const gold = paint(0xe6c15c, 0.4, 0.25);
  const plastic = paint(0x202226, 0.7);
  box(0, 0, 0, WIDE, LONG, THICK, paint(0x174b9c, 0.55));
  const picture = new CanvasTexture(silkScreen());
  picture.colorSpace = SRGBColorSpace;
  picture.anisotropy = 8;
  const top = new Mesh(new PlaneGeometry(LONG, WIDE), new MeshStandardMaterial({ map: picture, roughness: 0.5 }));
  top.rotation.z = -Math.PI / 2; // the picture's right is -y, its upper edge x
  top.position.z = THICK / 2 + 0.002;
  board.add(top);
  for (const [x, y, a, b, c, color] of PARTS) box(x, y, THICK / 2 + c / 2, a, b, c, paint(color, 0.45));
  box(PINS_X, 0, -THICK / 2 - 0.125, 0.25, PINS.length * PITCH, 0.25, plastic);
  for (let k = 0; k < PINS.length; k++) {
    box(PINS_X, (3.5 - k) * PITCH, -0.28, 0.05, 0.05, 0.95, gold);
  }
  for (const axis of "xyz") board.add(arrow(axis));
  return board;
}

/** @param {string} axis */
function arrow(axis) {
  const group = new Group();
  group.name = axis;
  const paint = new MeshStandardMaterial({ roughness: 0.45 });
  const length = axis === "z" ? UPRIGHT : ARROW;
  const shaft = new Mesh(new CylinderGeometry(0.032, 0.032, length - 0.2, 16), paint);
  shaft.position.y = (length - 0.2) / 2;
  const tip = new Mesh(new ConeGeometry(0.092, 0.24, 24), paint);
  tip.position.y = length - 0.1;
  group.add(shaft, tip);
  group.position.z = THICK / 2 + (axis === "z" ? 0 : 0.12);
  if (axis === "x") group.rotation.z = -Math.PI / 2;
  if (axis === "z") group.rotation.x = Math.PI / 2;
  return group;
}

/** Lines on the ground that fade away. */
function grid() {
  const places = [];
  const colours = [];
  const reach = 5, step = 0.5;
  const put = (x, y) => {
    places.push(x, y, GROUND_Z);
    colours.push(1, 1, 1, Math.max(0, 1 - Math.hypot(x, y) / reach) ** 1.5);
  };
  for (let a = -reach; a <= reach; a += step) {
    for (let b = -reach; b < reach; b += step) {
      put(a, b), put(a, b + step);
      put(b, a), put(b + step, a);
    }
  }
  const lines = new BufferGeometry();
  lines.setAttribute("position", new BufferAttribute(new Float32Array(places), 3));
  lines.setAttribute("color", new BufferAttribute(new Float32Array(colours), 4));
  return new LineSegments(lines, new LineBasicMaterial({ vertexColors: true, transparent: true }));
}

/** A level ring round the middle with a tick each ten degrees. */
function horizon() {
  const places = [];
  for (let k = 0; k < 180; k++) {
    const a = (k * Math.PI) / 90, b = ((k + 1) * Math.PI) / 90;
    places.push(RING * Math.cos(a), RING * Math.sin(a), 0, RING * Math.cos(b), RING * Math.sin(b), 0);
    if (k % 5) continue;
    const inner = RING - (k % 45 === 0 ? 0.2 : k % 15 === 0 ? 0.12 : 0.06);
    places.push(RING * Math.cos(a), RING * Math.sin(a), 0, inner * Math.cos(a), inner * Math.sin(a), 0);
  }
  const lines = new BufferGeometry();
  lines.setAttribute("position", new BufferAttribute(new Float32Array(places), 3));
  return new LineSegments(lines, new LineBasicMaterial());
}
