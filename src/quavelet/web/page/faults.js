// Faults of the fake chip: put one in, watch it being noticed and recovered.

import { byId, known, make, setText, units } from "./dom.js";
import { doing } from "./actions.js";
import { polite } from "./says.js";

const SHOWN = 6;

export class Faults {
  constructor(live) {
    this._live = live;
    this.place = byId("faults");
    this._buttons = make("div", { class: "fault-buttons" });
    this._lasting = make("p", { class: "note" });
    this._history = make("ol", { class: "fault-history", "aria-label": "Faults so far, the last one first" });
    this._counters = make("p", { class: "note" });
    this.place.append(
      make("h2", { id: "faults-title" }, "Break something"),
      make("p", { class: "note" }, "The chip is a fake, so it can be broken at will. What is lost is a gap with its length; the time goes on."),
      this._buttons, this._lasting, this._history, this._counters,
    );
  }

  /** @param {any} about */
  about(about) {
    this.empty = !about?.faults?.length;
    this._buttons.replaceChildren(
      ...(about?.faults ?? []).map((/** @type {any} */ f) => {
        const button = doing(this._live, "fault", "inject", units(f.title), { kind: "fault-button", values: () => ({ name: f.name }) });
        button.title = f.text ?? "";
        return button;
      }),
    );
  }

  /** @param {any} state */
  show(state) {
    this.place.hidden = this.empty && !state.history?.length;
    const past = (state.history ?? []).slice(-SHOWN).reverse();
    this._history.replaceChildren(...past.map(one));
    this._history.hidden = !past.length;
    const last = past[0];
    const told = last?.over && last.says ? `${last.title}: ${last.says}` : "";
    if (told && told !== this._told && this._told !== undefined) polite(told);
    this._told = told;
    const lasting = state.lasting ?? [];
    this._lasting.hidden = !lasting.length;
    setText(this._lasting, `Still there: ${lasting.map((/** @type {any} */ f) => f.title ?? f.name ?? String(f)).join(", ")}.`);
    const counters = Object.entries(state.counters ?? {}).filter(([, n]) => Number(n));
    this._counters.hidden = !counters.length;
    setText(this._counters, `Counted: ${counters.map(([name, n]) => `${name.replaceAll("_", " ")} ${n}`).join(", ")}.`);
  }
}

/** @param {any} f */
function one(f) {
  const noticed = !known(f.noticed_ms) ? (f.over ? "not noticed" : "not noticed yet") : `noticed after ${ms(f.noticed_ms)}`;
  const recovered = !known(f.recovered_ms) ? "" : `, well again ${ms(f.recovered_ms)} after its end`;
  const how = (f.how ?? []).map((/** @type {string} */ flag) => flag.replaceAll("_", " ")).join(", ");
  const level = known(f.recovered_ms) || f.over ? "good" : known(f.noticed_ms) ? "warn" : "idle";
  return make(
    "li",
    { "data-level": level },
    make("strong", {}, units(f.title)),
    make("span", {}, units(f.says || `${noticed}${recovered}`)),
    how && !f.says ? make("span", { class: "note" }, `by ${how}`) : null,
  );
}

/** @param {number} value */
const ms = (value) => (value < 1000 ? `${value < 10 ? value.toFixed(1) : Math.round(value)} ms` : `${(value / 1000).toFixed(1)} s`);
