// The page: what comes from the server goes to the part that shows it.

import { Record, Zero } from "./actions.js";
import { BoardView } from "./board_view.js";
import { Calibration } from "./calibration.js";
import { byId, clock, duration, known, setText, units } from "./dom.js";
import { Faults } from "./faults.js";
import { Health } from "./health.js";
import { Lateness } from "./lateness.js";
import { Mounting } from "./mounting.js";
import { Numbers } from "./numbers.js";
import { Replay } from "./replay.js";
import { assertive, begin, polite, talk } from "./says.js";
import { Live } from "./socket.js";
import { Strips } from "./strips.js";

const STALE_MS = 500;
const TOLD_MS = 2000;
const UNSURE_MS = 100;

if (location.hash.startsWith("#token=")) history.replaceState(null, "", location.pathname);

const board = new BoardView();
const numbers = new Numbers(polite);
const strips = new Strips();
const health = new Health();
const lateness = new Lateness();
/** @type {Record<string, any>} */
const abilities = {};
const link = { up: false, why: "", again_at_ms: 0 };
let fresh_ms = -Infinity;
let last_t_ns = NaN;
let stale = true;
let told = false;
let asked_again = false;

const live = new Live({
  hello(frame) {
    begin();
    setText(byId("name"), frame.name);
    setText(byId("source"), frame.src);
    document.title = `${frame.name} · quavelet`;
    setText(byId("foot"), `quavelet ${frame.version}`);
    byId("fake").hidden = !frame.fake;
    setText(byId("fake-text"), `all of it made up by ${frame.src}`);
    const kinds = { zero: Zero, record: Record, mounting: Mounting, play: Replay, fault: Faults, calibrate: Calibration };
    for (const [name, about] of Object.entries(frame.abilities ?? {})) {
      const kind = kinds[/** @type {keyof kinds} */ (name)];
      if (!kind) continue;
      abilities[name] ??= new kind(live);
      abilities[name].about?.(about);
    }
    byId("actions").hidden = !("zero" in abilities || "record" in abilities || "mounting" in abilities);
    strips.running = !("play" in abilities);
  },
  history: (frame) => strips.replace(frame),
  message(frame) {
    const m = frame.m;
    if (abilities.fault?.empty && !asked_again) {
      asked_again = true; // a chip that has not answered offers no faults, and what is offered is told once
      live.reopen();
    }
    if (m.t_ns !== last_t_ns) fresh_ms = performance.now();
    last_t_ns = m.t_ns;
    health.temp_degc = m.temp_degc;
    strips.add(m);
    board.show(m);
    numbers.show(m);
    if (stale) look();
  },
  status(frame) {
    health.show(frame);
    lateness.show(frame);
  },
  ability: (frame) => abilities[frame.name]?.show(frame.state),
  talk,
  link(now) {
    link.up = now.up;
    link.why = now.why;
    link.again_at_ms = performance.now() + now.again_ms;
    look();
  },
});

board.onDrawn = (t_ns) => {
  if (live.offset_ms !== null && live.trip_ms < UNSURE_MS && !abilities.play && !stale) lateness.drawn(performance.now() + live.offset_ms - t_ns / 1e6);
};

/** What stands still is not to be taken for what is: greyed, with the time since, and why. */
function look() {
  const now_ms = performance.now();
  const silent_ms = now_ms - fresh_ms;
  const play = abilities.play?.state;
  const seeking = Boolean(link.up && play && known(play.wanted_s));
  const resting = Boolean(link.up && play && !seeking && (play.paused || play.ended));
  stale = !resting && silent_ms > STALE_MS;
  document.body.classList.toggle("stale", stale);
  document.body.classList.toggle("paused", resting);
  const reading = seeking ? `${clock(play.wanted_s)} is not read yet` : "";
  const since = reading || (Number.isFinite(silent_ms) ? `no data for ${duration(silent_ms / 1000)}` : "no data yet");
  const again_s = Math.ceil((link.again_at_ms - now_ms) / 1000);
  const why = !link.up
    ? `${link.why || `No connection to quavelet at ${location.host}.`} ${again_s > 0 ? `Trying again in ${again_s} s.` : "Trying again."}`
    : seeking ? `The recording is read from its beginning; it is known up to ${clock(play.known_s)}.` : health.trouble || "quavelet is there, but gives no attitude.";
  byId("veil").hidden = !stale || (fresh_ms === -Infinity && now_ms < TOLD_MS);
  if (stale) {
    setText(byId("veil-what"), since);
    setText(byId("veil-why"), units(` ${why}${link.up && !seeking && health.remedy ? ` ${health.remedy}` : ""}`));
  }
  const [level, text] = !link.up
    ? [fresh_ms === -Infinity ? "idle" : "bad", fresh_ms === -Infinity ? "connecting" : "connection lost"]
    : seeking ? ["idle", "seeking"] : stale ? ["bad", "no data"] : resting ? ["idle", play.ended ? "ended" : "paused"] : play ? ["good", "playing"] : ["good", "live"];
  byId("link").dataset.level = level;
  setText(byId("link-text"), text);
  if (stale && !told && silent_ms > TOLD_MS && fresh_ms > 0) {
    told = true;
    assertive(`${since}. ${why}`);
  } else if (!stale && told) {
    told = false;
    polite("Data comes again.");
  }
}
setInterval(look, 200);
