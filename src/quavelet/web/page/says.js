// What is said to the viewer: short notices that go by themselves, and live regions for a screen reader.

import { byId, make, units } from "./dom.js";

const STAYS_MS = 6000;
const LINES = 60;

/** The answer to something that was done here. @param {{ok: boolean, text: string}} answer */
export function told(answer) {
  const toast = make("p", { class: "toast", "data-level": answer.ok ? "good" : "bad" }, sentence(answer.text));
  byId("toasts").append(toast);
  setTimeout(() => toast.remove(), answer.ok ? STAYS_MS : 2 * STAYS_MS);
  while (byId("toasts").childElementCount > 3) byId("toasts").firstElementChild?.remove();
}

/** With a capital and a stop, units as people write them. @param {string} text */
function sentence(text) {
  const said = units(text.trim());
  return said.charAt(0).toUpperCase() + said.slice(1) + (/[.!?]$/.test(said) ? "" : ".");
}

/** A change of state, when the reader has time. @param {string} text */
export const polite = (text) => (byId("polite").textContent = text);

/** Trouble, at once. @param {string} text */
export const assertive = (text) => (byId("assertive").textContent = text);

const PAST_MS = 1000;
let since_ms = 0;

/** A connection begins: what the program said before comes again, and nobody knows when it was. */
export function begin() {
  since_ms = performance.now();
  byId("talk").replaceChildren(make("li", { class: "note" }, "Nothing yet."));
}

/** A line of the program's own talk. @param {{level: string, text: string}} frame */
export function talk(frame) {
  const list = byId("talk");
  list.querySelector(".note")?.remove();
  const past = performance.now() - since_ms < PAST_MS;
  const at = past ? "before" : new Date().toLocaleTimeString([], { hour: "2-digit", minute: "2-digit", second: "2-digit", hour12: false });
  const last = /** @type {HTMLElement|null} */ (list.lastElementChild);
  if (last?.dataset.text === frame.text) {
    const times = Number(last.dataset.times ?? 1) + 1;
    last.dataset.times = String(times);
    /** @type {HTMLElement} */ (last.querySelector("time")).textContent = `${at}, ${times} times`;
    return;
  }
  const below = list.scrollTop + list.clientHeight > list.scrollHeight - 8;
  list.append(make("li", { "data-level": frame.level, "data-text": frame.text }, make("time", {}, at), ` ${frame.text}`));
  while (list.childElementCount > LINES) list.firstElementChild?.remove();
  if (below) list.scrollTop = list.scrollHeight;
}
