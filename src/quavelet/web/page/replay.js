// Playing a recording: an overview of all of it to seek in, pause, and speed. Space and the arrows do, too.

import { byId, clock, colour, make, setText } from "./dom.js";
import { told } from "./says.js";

const SPEEDS = [0.25, 0.5, 1, 2, 4, 8];
const STEP_S = 5;
const SEEK_MS = 120; // while it is dragged

/** Which overview it is, as it grows. @param {any} overview */
const of = (overview) => overview && `${overview.t_s.length} ${overview.t_s.at(-1)} ${overview.gaps.length}`;

export class Replay {
  constructor(live) {
    this._live = live;
    this.place = byId("replay");
    this._play = /** @type {HTMLButtonElement} */ (make("button", { type: "button", class: "play", "aria-label": "Pause", onclick: () => this._toggle() }));
    this._canvas = /** @type {HTMLCanvasElement} */ (make("canvas", { "aria-hidden": "true" }));
    this._slider = /** @type {HTMLInputElement} */ (make("input", { type: "range", min: "0", step: "any", value: "0", "aria-label": "Time in the recording" }));
    this._cursor = make("i", { class: "cursor", "aria-hidden": "true" });
    this._unread = make("i", { class: "unread", "aria-hidden": "true" });
    this._time = make("p", { class: "time" });
    this._speed = /** @type {HTMLSelectElement} */ (make("select", { "aria-label": "Speed" }, ...SPEEDS.map((x) => make("option", { value: x }, `${String(x).replace("0.25", "¼").replace("0.5", "½")}×`))));
    this._file = make("p", { class: "file" });
    this.place.append(
      this._play, make("div", { class: "track" }, this._canvas, this._unread, this._cursor, this._slider), this._time, this._speed, this._file,
    );
    this._speed.addEventListener("change", () => this._do("speed", { x: Number(this._speed.value) }));
    this._slider.addEventListener("input", () => this._seek(Number(this._slider.value)));
    this._slider.addEventListener("change", () => this._seek(Number(this._slider.value), true));
    document.addEventListener("keydown", (event) => this._key(event));
    new ResizeObserver(() => this._draw()).observe(this._canvas);
    addEventListener("theme", () => this._draw());
    this.t_s = 0;
    this._sought_ms = 0;
  }

  /** @param {any} about */
  about(about) {
    this._overview = about.overview ?? null;
    this.length_s = about.length_s ?? 0;
    this._name = about.file ?? "";
    this._draw();
  }

  /** @param {any} state */
  show(state) {
    this.place.hidden = false;
    document.body.classList.add("has-replay");
    this.state = state;
    this.length_s = state.length_s || this.length_s;
    this._unread.style.left = `${this.length_s ? Math.min(100, (100 * state.known_s) / this.length_s) : 0}%`;
    // The same one comes several times while it is news.
    if (state.overview && of(state.overview) !== of(this._overview)) {
      this._overview = state.overview;
      this._draw();
    }
    this._play.dataset.does = state.ended ? "again" : state.paused ? "play" : "pause";
    this._play.setAttribute("aria-label", state.ended ? "Play again" : state.paused ? "Play" : "Pause");
    this._speed.value = String(state.speed);
    setText(this._file, state.says || this._name);
    this._file.classList.toggle("trouble", Boolean(state.says));
    if (performance.now() - this._sought_ms > 400) this._at(state.wanted_s ?? state.t_s);
  }

  /** @param {number} t_s */
  _at(t_s) {
    this.t_s = t_s;
    this._slider.max = String(this.length_s);
    this._slider.value = String(t_s);
    this._slider.setAttribute("aria-valuetext", `${clock(t_s)} of ${clock(this.length_s)}`);
    this._cursor.style.left = `${this.length_s ? (100 * t_s) / this.length_s : 0}%`;
    const now = this.state?.ended ? " ended" : this.state?.paused ? " paused" : "";
    setText(this._time, `${clock(t_s)} / ${clock(this.length_s)}${now}`);
  }

  _toggle() {
    if (this.state?.ended) this._seek(0, true);
    this._do(this.state?.paused || this.state?.ended ? "resume" : "pause");
  }

  /** @param {number} t_s */
  _seek(t_s, at_once = false) {
    t_s = Math.max(0, Math.min(this.length_s, t_s));
    this._at(t_s);
    const now_ms = performance.now();
    clearTimeout(this._later);
    const wait_ms = at_once ? 0 : Math.max(0, SEEK_MS - (now_ms - this._sent_ms || SEEK_MS));
    this._sought_ms = now_ms;
    this._later = setTimeout(() => {
      this._sent_ms = performance.now();
      this._do("seek", { t_s });
    }, wait_ms);
  }

  /** @param {string} what @param {object} [values] */
  async _do(what, values) {
    const answer = await this._live.do("play", what, values);
    if (!answer.ok) told(answer);
  }

  /** @param {KeyboardEvent} event */
  _key(event) {
    if (this.place.hidden || event.altKey || event.ctrlKey || event.metaKey) return;
    const target = /** @type {HTMLElement} */ (event.target);
    if (target !== this._slider && target.closest("button, a, input, select, textarea, summary, [tabindex='0']")) return;
    if (event.key === " ") this._toggle();
    else if (event.key === "ArrowLeft") this._seek(this.t_s - STEP_S, true);
    else if (event.key === "ArrowRight") this._seek(this.t_s + STEP_S, true);
    else if (event.key === "Home") this._seek(0, true);
    else return;
    event.preventDefault();
  }

  _draw() {
    const canvas = this._canvas;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width || !this._overview) return;
    const scale = devicePixelRatio;
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
    const c = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
    c.scale(scale, scale);
    const { t_s, gaps } = this._overview;
    const x = (/** @type {number} */ s) => (width * s) / (this.length_s || 1);
    c.fillStyle = colour("--gap");
    for (const [from, to] of gaps ?? []) c.fillRect(x(from), 0, Math.max(2, x(to) - x(from)), height);
    for (const [name, ink] of [["yaw_deg", "--z"], ["pitch_deg", "--y"], ["roll_deg", "--x"]]) {
      const values = this._overview[name] ?? [];
      const most = Math.max(10, ...values.map(Math.abs));
      c.strokeStyle = colour(ink);
      c.globalAlpha = name === "yaw_deg" ? 0.5 : 0.9;
      c.lineWidth = 1.2;
      c.beginPath();
      for (let k = 0; k < values.length; k++) {
        const y = height / 2 - (values[k] / most) * (height / 2 - 3);
        const jump = k && Math.abs(values[k] - values[k - 1]) > 180;
        if (k && !jump) c.lineTo(x(t_s[k]), y);
        else c.moveTo(x(t_s[k]), y);
      }
      c.stroke();
    }
    c.globalAlpha = 1;
  }
}
