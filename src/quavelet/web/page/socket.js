// The one websocket: reconnects by itself, knows how the server's clock stands to this one, and notices silence.

const FIRST_MS = 250;
const LONGEST_MS = 4000;
const SILENT_MS = 5000; // status comes every second
const LOOK_MS = 1000;
const PING_MS = 2000;

export class Live {
  /** @param {Record<string, (frame: any) => void>} on  by the frame's `is`; "link" is told {up, why, again_ms} */
  constructor(on) {
    this.on = on;
    this.up = false;
    /** performance.now() + offset_ms is the server's CLOCK_MONOTONIC in ms; null until measured. */
    this.offset_ms = /** @type {number|null} */ (null);
    /** How long that measurement took; it may be wrong by half of it. */
    this.trip_ms = Infinity;
    this._best_ms = Infinity;
    this._wait_ms = FIRST_MS;
    this._n = 0;
    this._asked = new Map();
    this._pings = new Map();
    this._heard_ms = 0;
    this._looked_ms = 0;
    this._again = 0;
    this._connect();
    setInterval(() => this._look(), LOOK_MS);
    addEventListener("online", () => this._soon(0));
    document.addEventListener("visibilitychange", () => document.hidden || this.up || this._soon(0));
  }

  /**
   * Ask for something to be done; the answer is {ok, text}.
   * @param {string} ability @param {string} what @param {object} [values] @returns {Promise<{ok: boolean, text: string}>}
   */
  do(ability, what, values = {}) {
    if (!this.up) return Promise.resolve({ ok: false, text: "There is no connection to quavelet at this moment." });
    const n = ++this._n;
    return new Promise((resolve) => {
      this._asked.set(n, resolve);
      this._socket.send(JSON.stringify({ n, ability, what, values }));
    });
  }

  /** Connect anew, as after a loss. */
  reopen() {
    this._socket.close();
    this._wait_ms = 0;
  }

  _connect() {
    this._again = 0;
    const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live`);
    this._socket = socket;
    let opened = false;
    socket.onopen = () => {
      opened = true;
      this._heard_ms = performance.now();
      this._best_ms = Infinity;
      this._pings.clear();
      this.up = true;
      this.on.link?.({ up: true, why: "", again_ms: 0 });
      this._ping();
    };
    socket.onmessage = (event) => {
      this._heard_ms = performance.now();
      this._wait_ms = FIRST_MS;
      this._take(JSON.parse(event.data));
    };
    socket.onclose = (event) => {
      if (socket !== this._socket) return;
      this.up = false;
      for (const resolve of this._asked.values()) resolve({ ok: false, text: "The connection was lost; whether it was done is not known." });
      this._asked.clear();
      this._lost(opened ? event.reason : "");
      if (!opened) this._why();
    };
  }

  /** @param {string} why */
  _lost(why) {
    const again_ms = this._wait_ms * (0.8 + 0.4 * Math.random());
    this._wait_ms = Math.min(LONGEST_MS, Math.max(FIRST_MS, 2 * this._wait_ms));
    this.on.link?.({ up: false, why, again_ms });
    this._soon(again_ms);
  }

  /** A refused websocket says nothing to a script; the same address by GET does. */
  async _why() {
    try {
      const answer = await fetch("/live", { cache: "no-store" });
      if (answer.status === 401) location.reload(); // to where the token is asked for
      else if (answer.status === 503 && !this.up) this.on.link?.({ up: false, why: await answer.text(), again_ms: 0 });
    } catch {
      // nobody is there: what is shown already says so
    }
  }

  /** @param {number} ms */
  _soon(ms) {
    if (this.up || this._socket?.readyState === WebSocket.CONNECTING) return;
    clearTimeout(this._again);
    this._again = setTimeout(() => this._connect(), ms);
  }

  _look() {
    const now_ms = performance.now();
    // A page that was held up itself has yet to take what came meanwhile.
    if (now_ms - this._looked_ms > 2 * LOOK_MS) this._heard_ms = now_ms;
    this._looked_ms = now_ms;
    if (!this.up) return;
    if (now_ms - this._heard_ms > SILENT_MS) {
      const socket = this._socket;
      this._socket.onclose?.(new CloseEvent("close", { reason: "Nothing came for five seconds." }));
      socket.onmessage = socket.onclose = null;
      socket.close();
    } else if (now_ms - (this._pinged_ms ?? 0) > PING_MS) this._ping();
  }

  _ping() {
    const n = ++this._n;
    this._pinged_ms = performance.now();
    this._pings.clear();
    this._pings.set(n, this._pinged_ms);
    this._socket.send(JSON.stringify({ ping: n }));
  }

  /** @param {any} frame */
  _take(frame) {
    if (frame.is === "pong") {
      const sent_ms = this._pings.get(frame.n);
      if (sent_ms === undefined) return;
      const trip_ms = performance.now() - sent_ms;
      this._best_ms += 1; // an old measurement counts for less, as clocks drift apart
      if (trip_ms < this._best_ms) {
        this._best_ms = trip_ms;
        this.trip_ms = trip_ms;
        this.offset_ms = frame.now_ns / 1e6 - (sent_ms + trip_ms / 2);
      }
    } else if (frame.is === "answer") {
      this._asked.get(frame.n)?.(frame);
      this._asked.delete(frame.n);
    } else this.on[frame.is]?.(frame);
  }
}
