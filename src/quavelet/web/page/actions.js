// What can be done with the running program: yaw from here, and recordings.

import { byId, duration, known, make, setText, size } from "./dom.js";
import { told } from "./says.js";

const SURE_MS = 4000;

/** A button that asks the server, is not to be pressed twice meanwhile, and tells the answer. */
export function doing(/** @type {any} */ live, ability, what, title, { kind = "", values = () => ({}) } = {}) {
  const button = /** @type {HTMLButtonElement} */ (make("button", { type: "button", class: kind }, title));
  button.addEventListener("click", async () => {
    if (button.getAttribute("aria-disabled") === "true") return;
    button.setAttribute("aria-disabled", "true"); // not `disabled`, which would lose the keyboard's place
    const answer = await live.do(ability, what, values());
    button.removeAttribute("aria-disabled");
    told(answer);
  });
  return button;
}

export class Zero {
  constructor(live) {
    this.place = byId("zero");
    this._why = make("p", { class: "note", id: "zero-why" });
    this._now = doing(live, "zero", "now", "Yaw counts from here");
    this._now.setAttribute("aria-describedby", "zero-why");
    this._undo = doing(live, "zero", "undo", "Undo", { kind: "quiet-button" });
    this.place.append(make("h3", {}, "Yaw"), this._why, make("div", { class: "buttons" }, this._now, this._undo));
  }

  /** @param {any} state */
  show(state) {
    this.place.hidden = false;
    const at = state.zeroed_deg;
    this._now.disabled = !state.possible;
    this._undo.hidden = !known(at);
    setText(
      this._why,
      state.why || (this._undo.hidden ? "It counts from the start of the program." : `It was set to zero; by itself it would read ${at.toFixed(1)}° more.`),
    );
  }
}

export class Record {
  constructor(live) {
    this._live = live;
    this.place = byId("record");
    this._says = make("p", { class: "note" });
    this._start = doing(live, "record", "start", "Record", { kind: "record-button" });
    this._stop = doing(live, "record", "stop", "Stop recording", { kind: "record-button running" });
    this._files = make("ul", { class: "files", "aria-label": "Recordings" });
    this.place.append(make("h3", {}, "Recording"), this._says, make("div", { class: "buttons" }, this._start, this._stop), this._files);
    this._listed = "";
    setInterval(() => this._count(), 1000);
  }

  /** @param {any} state */
  show(state) {
    this.place.hidden = false;
    this._state = state;
    this._at_ms = performance.now();
    this._start.hidden = state.recording;
    this._start.disabled = Boolean(state.why);
    this._stop.hidden = !state.recording;
    this._stop.disabled = !known(state.since_ns);
    this._count();
    const ended = (state.files ?? []).filter((/** @type {any} */ f) => f.ended);
    const text = JSON.stringify(ended);
    if (text === this._listed) return;
    this._listed = text;
    this._files.replaceChildren(...ended.map((/** @type {any} */ f) => this._file(f)));
  }

  _count() {
    const s = this._state;
    if (!s) return;
    if (!s.recording) return setText(this._says, s.why || "What is read from the chip, byte for byte; quavelet replay plays it.");
    const offset_ms = this._live.offset_ms;
    if (!known(s.since_ns) || !s.file) return setText(this._says, s.why || "It begins with the next samples.");
    const for_s = offset_ms === null ? 0 : (performance.now() + offset_ms) / 1000 - s.since_ns / 1e9;
    setText(this._says, `Recording ${s.file}: ${duration(Math.max(0, for_s))}, ${size(s.bytes)}.${s.why ? ` ${s.why}` : ""}`);
  }

  /** @param {{name: string, bytes: number}} file */
  _file(file) {
    const link = make("a", { href: `/recordings/${encodeURIComponent(file.name)}`, download: file.name }, file.name);
    const gone = make("button", { type: "button", class: "quiet-button", "aria-label": `Delete ${file.name}` }, "Delete");
    let sure = 0;
    gone.addEventListener("click", async () => {
      if (!sure) {
        gone.textContent = "Really?";
        gone.setAttribute("aria-label", `Really delete ${file.name}?`);
        sure = setTimeout(() => {
          sure = 0;
          gone.textContent = "Delete";
          gone.setAttribute("aria-label", `Delete ${file.name}`);
        }, SURE_MS);
        return;
      }
      told(await this._live.do("record", "delete", { name: file.name }));
    });
    return make("li", {}, link, make("span", { class: "note" }, size(file.bytes)), gone);
  }
}
