// The mounting check: lay it level, lift the front; is what is shown what was done?

import { byId, make, setText } from "./dom.js";
import { doing } from "./actions.js";
import { polite, told } from "./says.js";

const VERDICTS = { right: "good", wrong: "bad", unclear: "warn" };

export class Mounting {
  constructor(live) {
    this.place = byId("mounting");
    this._ask = make("p", { class: "ask" });
    this._says = make("p", { class: "verdict" });
    this._toml = make("pre", { tabindex: "0", "aria-label": "Settings" });
    this._copy = make("button", { type: "button", class: "quiet-button", onclick: () => this._copied() }, "Copy");
    this._start = doing(live, "mounting", "start", "Check the mounting");
    this._next = doing(live, "mounting", "next", "Done, go on", { kind: "primary" });
    this._stop = doing(live, "mounting", "stop", "Stop", { kind: "quiet-button" });
    this.place.append(
      make("h3", {}, "Mounting"), this._ask, this._says, this._toml,
      make("div", { class: "buttons" }, this._start, this._next, this._copy, this._stop),
    );
  }

  /** @param {any} about */
  about(about) {
    const axes = Object.entries(about?.axes ?? {}).map(([body, chip]) => `${body} = ${chip}`);
    this._idle = `Does the picture turn as the board does? ${axes.length ? `As it is set, of the chip's axes: ${axes.join(", ")}.` : ""}`;
  }

  /** @param {any} state */
  show(state) {
    this.place.hidden = false;
    const idle = state.step === "idle", done = state.step === "done";
    const ask = idle ? (this._idle ?? "") : state.ask;
    if (!idle && ask && ask !== this._ask.textContent) polite(ask);
    setText(this._ask, ask);
    this._ask.classList.toggle("asked", !idle);
    this._ask.hidden = !ask;
    if (state.says && state.says !== this._says.textContent) polite(state.says);
    setText(this._says, state.says ?? "");
    this._says.hidden = !state.says;
    this._says.dataset.level = VERDICTS[/** @type {keyof VERDICTS} */ (state.verdict)] ?? "";
    const toml = done && state.verdict !== "right" ? (state.toml ?? "") : "";
    setText(this._toml, toml);
    this._toml.hidden = this._copy.hidden = !toml;
    this._start.hidden = !idle && !done;
    setText(this._start, done ? "Check again" : "Check the mounting");
    this._next.hidden = idle || done;
    this._stop.hidden = idle;
    setText(this._stop, done ? "Close" : "Stop");
  }

  async _copied() {
    try {
      await navigator.clipboard.writeText(this._toml.textContent ?? "");
      told({ ok: true, text: "Copied." });
    } catch {
      told({ ok: false, text: "The browser does not let it be copied: mark it and copy by hand." });
    }
  }
}
