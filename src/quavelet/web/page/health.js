// How chip, bus and program are: sentences of the server, what and what to do, and the figures behind them.

import { byId, duration, make, setText, units } from "./dom.js";
import { assertive, polite } from "./says.js";

const MARK = { good: "✓", warn: "!", bad: "✕" };
const SEEN = { good: "well", warn: "note", bad: "trouble" };

export class Health {
  constructor() {
    this._words = "";
    this._bad = "";
    this._facts = new Map();
    this._counters = new Map();
    /** What the server says is wrong, "" where nothing is. */
    this.trouble = "";
    this.remedy = "";
  }

  /** @param {any} frame  status */
  show(frame) {
    const words = frame.words ?? [];
    const bad = words.filter((/** @type {any} */ w) => w.level === "bad");
    this.trouble = bad[0]?.what ?? "";
    this.remedy = bad[0]?.do ?? "";
    const text = JSON.stringify(words.map((/** @type {any} */ w) => [w.level, w.what, w.do]));
    if (text !== this._words) {
      this._words = text;
      byId("words").replaceChildren(...words.map(sentence));
    }
    // Figures inside a sentence change all the time; the same trouble is told once.
    const kinds = bad.map((/** @type {any} */ w) => w.what.replace(/[\d.,]+/g, "")).join();
    if (kinds !== this._bad) {
      this._bad = kinds;
      if (bad.length) assertive(bad.map((/** @type {any} */ w) => `${w.what} ${w.do}`).join(" "));
      else polite("All is well again.");
    }
    this._figures(frame);
  }

  /** @param {any} frame */
  _figures(frame) {
    const s = frame.s;
    const h = s.health;
    this._fact("state", s.state);
    this._fact("chip", s.chip ? `${s.chip} at 0x${s.address.toString(16)}` : `none yet at 0x${s.address.toString(16)}`);
    this._fact("temperature", s.message ? `${s.message.temp_degc.toFixed(1)} °C` : this.temp_degc === undefined ? "–" : `${this.temp_degc.toFixed(1)} °C`);
    this._fact("rate", s.rate_hz === null || s.rate_hz === undefined ? "not measured yet" : `${s.rate_hz.toFixed(2)} samples/s`);
    this._fact("lost", `${h.samples_lost} of ${h.samples + h.samples_lost} samples in ${h.gaps} ${h.gaps === 1 ? "gap" : "gaps"}`);
    this._fact("bus", h.bus_errors ? `${h.bus_errors} failed transfers, ${h.bus_retries} tried again` : "no failed transfer");
    this._fact("up for", duration(s.uptime_s));
    if (s.recording) this._fact("recording", s.recording.state);
    const left = Object.values(frame.viewers?.dropped ?? {}).reduce((a, b) => a + Number(b), 0);
    this._fact("viewers", `${frame.viewers?.now ?? 1}${left ? `, ${left} dropped` : ""}`);
    for (const [name, count] of Object.entries(h)) this._count(name, Number(count));
  }

  /** @param {string} name @param {string} value */
  _fact(name, value) {
    let place = this._facts.get(name);
    if (!place) {
      place = make("dd", {});
      this._facts.set(name, place);
      byId("facts").append(make("div", {}, make("dt", {}, name), place));
    }
    setText(place, value);
  }

  /** @param {string} name @param {number} count */
  _count(name, count) {
    let place = this._counters.get(name);
    if (!place) {
      place = make("td", {});
      this._counters.set(name, place);
      byId("counters").append(make("tr", {}, make("th", { scope: "row" }, name.replaceAll("_", " ")), place));
    }
    setText(place, String(count));
  }
}

/** @param {{level: "good"|"warn"|"bad", what: string, do: string}} word */
function sentence(word) {
  return make(
    "li",
    { "data-level": word.level },
    make("span", { class: "mark-of", "aria-hidden": "true" }, MARK[word.level] ?? "·"),
    make("p", {}, make("span", { class: "unseen" }, `${SEEN[word.level] ?? word.level}: `), make("strong", {}, units(word.what)), word.do ? make("span", { class: "do" }, units(word.do)) : null),
  );
}
