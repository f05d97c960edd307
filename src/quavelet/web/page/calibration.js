// The calibration session: which steps, what to do at this moment, the board as it lies, and the verdict.

import { BoardPlain } from "./board_plain.js";
import { doing } from "./actions.js";
import { byId, make, setText, signed, units } from "./dom.js";
import { polite } from "./says.js";
import { View } from "./view.js";

const WORDS = { good: "Good", warn: "Usable", bad: "Not good enough" };

export class Calibration {
  constructor(live) {
    this.place = byId("calibration");
    this._steps = make("ol", { class: "steps" });
    this._instruction = make("p", { class: "instruction" });
    this._notice = make("p", { class: "notice", role: "status" });
    this._still = make("progress", { max: "1", "aria-label": "Still for" });
    this._facts = make("p", { class: "note" });
    this._scene = make("div", { class: "scene" });
    this._picture = make("div", { class: "board small", role: "img", "aria-label": "The board on the bench" }, this._scene);
    this._result = make("div", { class: "result" });
    this._says = make("p", { class: "note" });
    this._start = doing(live, "calibrate", "start", "Calibrate", { kind: "primary" });
    this._stop = doing(live, "calibrate", "stop", "Stop", { kind: "quiet-button" });
    this._running = make("div", { class: "session" }, this._steps, make("div", { class: "bench" }, this._picture, this._instruction, this._still, this._facts, this._notice));
    this.place.append(
      make("div", { class: "card-head" }, make("h2", { id: "calibration-title" }, "Calibration"), make("div", { class: "buttons" }, this._start, this._stop)),
      this._says, this._running, this._result,
    );
    this._view = new View();
    this._drawn = new Float64Array(4);
    this._q = new Float64Array([1, 0, 0, 0]);
    this._asked = 0;
    this._listed = "";
  }

  /** @param {any} state */
  show(state) {
    this.place.hidden = false;
    this._start.hidden = state.running;
    this._stop.hidden = !state.running;
    setText(this._start, state.result ? "Calibrate again" : "Calibrate");
    setText(
      this._says,
      state.running
        ? `On a fake of its own, ${state.speed} times as fast as it would go on a bench.`
        : state.why && !state.result ? `The session has ended: ${state.why}.` : "Another fake chip is calibrated as a person would do it, turned by a hand that obeys. quavelet calibrate does it with yours.",
    );
    this._running.hidden = !state.running || !state.view;
    if (state.running && state.view) this._session(state.view);
    if (state.running && state.q) this._turn(state.q);
    this._verdict(state.running ? null : state.result);
  }

  /** @param {any} view */
  _session(view) {
    const steps = view.steps.map((/** @type {any} */ s) => (Array.isArray(s) ? { name: s[0], title: s[1], progress: s[2] } : s));
    const names = steps.map((/** @type {any} */ s) => s.title).join();
    if (names !== this._listed) {
      this._listed = names;
      this._steps.replaceChildren(
        ...steps.map((/** @type {any} */ s) => make("li", {}, make("span", {}, s.title), make("progress", { max: "1", "aria-label": `${s.title}: done` }), make("span", { class: "note" }))),
      );
    }
    steps.forEach((/** @type {any} */ s, /** @type {number} */ k) => {
      const line = this._steps.children[k];
      const at = k === view.at;
      line.className = at ? "at" : s.progress >= 1 ? "done" : "";
      if (at) line.setAttribute("aria-current", "step");
      else line.removeAttribute("aria-current");
      /** @type {HTMLProgressElement} */ (line.children[1]).value = s.progress;
      setText(line.children[2], at ? units(view.status) : s.progress >= 1 ? "done" : "");
    });
    const instruction = view.instruction || "All is measured.";
    if (units(instruction) !== this._instruction.textContent) polite(instruction);
    setText(this._instruction, units(instruction));
    setText(this._notice, units(view.notice ?? ""));
    const needs = view.needs_s || 0;
    this._still.hidden = !needs;
    /** @type {HTMLProgressElement} */ (this._still).value = needs ? Math.min(1, view.still_s / needs) : 0;
    const still = view.still_s > 0 ? `still for ${view.still_s.toFixed(1)} s` : "moving";
    const turned = Math.abs(view.turned_deg) >= 10 ? `, turned by ${signed(view.turned_deg, 0)}°` : "";
    const face = `${view.face || "no face"} up${view.asked_face && view.asked_face !== view.face ? `, asked for ${view.asked_face}` : ""}`;
    setText(this._facts, `${still}${turned}; ${face}${typeof view.temp_degc === "number" ? `; ${view.temp_degc.toFixed(1)} °C` : ""}`);
  }

  /** @param {number[]} q */
  _turn(q) {
    this._q.set(q);
    this._asked ||= requestAnimationFrame(() => {
      this._asked = 0;
      this._board ??= new BoardPlain(this._scene);
      const { clientWidth, clientHeight } = this._picture;
      if (clientWidth !== this._view.width || clientHeight !== this._view.height) {
        this._view.resize(clientWidth, clientHeight);
        this._board.resize(this._view);
      }
      this._board.draw(this._q, 0, 0, this._drawn);
      this._picture.dataset.q = Array.from(this._drawn, (v) => v.toFixed(7)).join();
    });
  }

  /** @param {any} result */
  _verdict(result) {
    const text = JSON.stringify(result ?? null);
    if (text === this._told) return;
    const first = this._told === undefined;
    this._told = text;
    if (!result) return this._result.replaceChildren();
    const title = `${WORDS[/** @type {keyof WORDS} */ (result.verdict)] ?? result.verdict}`;
    if (!first) polite(`The calibration has ended: ${title}.`);
    this._result.replaceChildren(
      make("p", { class: "verdict", "data-level": result.verdict }, title),
      make("ul", { class: "words" }, ...(result.lines ?? []).map((/** @type {any} */ l) =>
        make("li", { "data-level": l.level }, make("span", { class: "mark-of", "aria-hidden": "true" }, { good: "✓", warn: "!", bad: "✕" }[l.level] ?? "·"), make("p", {}, make("strong", {}, l.title), make("span", { class: "do" }, units([l.text, l.do].filter(Boolean).join(". "))))))),
    );
  }
}
