// What the strips hold: ten minutes in typed arrays that are made once, and the least and most of what lies in a
// column of the picture.

export const CHANNELS = ["roll_deg", "pitch_deg", "yaw_deg", "gyro_x_dps", "gyro_y_dps", "gyro_z_dps", "temp_degc"];
const ROWS = 20480; // ten minutes at 30 Hz, and some
const BREAK_S = 0.5;

export class Ring {
  constructor() {
    this.t_s = new Float64Array(ROWS);
    this.values = CHANNELS.map(() => new Float32Array(ROWS));
    /** Seconds without samples just before the row. */
    this.gap_s = new Float32Array(ROWS);
    this.clear();
  }

  clear() {
    this._next = 0;
    this.rows = 0;
  }

  get last_s() {
    return this.rows ? this.t_s[(this._next + ROWS - 1) % ROWS] : NaN;
  }

  /** @param {number} t_s @param {number} gap_s @param {ArrayLike<number>} row  as CHANNELS */
  add(t_s, gap_s, row) {
    if (t_s <= this.last_s) {
      if (t_s === this.last_s) return;
      this.clear(); // time went back: what was held belongs to another time
    }
    const at = this._next;
    this.t_s[at] = t_s;
    this.gap_s[at] = gap_s;
    for (let k = 0; k < row.length; k++) this.values[k][at] = row[k];
    this._next = (at + 1) % ROWS;
    this.rows = Math.min(ROWS, this.rows + 1);
  }

  /** Number, counted from the oldest, of the first row at or after the time. @param {number} t_s */
  find(t_s) {
    let low = 0, high = this.rows;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.t_s[this.at(middle)] < t_s) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /** @param {number} k  counted from the oldest */
  at(k) {
    return (this._next - this.rows + k + 2 * ROWS) % ROWS;
  }
}

/** The rows from `from_s` to `to_s`, as `columns` of the picture at the most, in arrays that are used again. */
export class Drawn {
  /** @param {number} most  columns */
  constructor(most) {
    this.x = new Float64Array(2 * most);
    this.y = CHANNELS.map(() => new Float64Array(2 * most));
    this.gaps = new Float64Array(512); // from, to, from, to, ...
    this.rows = 0;
    this.gap_count = 0;
    this._most = most;
  }

  /** @param {Ring} ring @param {number} from_s @param {number} to_s @param {number} columns */
  take(ring, from_s, to_s, columns) {
    const first = Math.max(0, ring.find(from_s) - 1);
    const count = ring.rows - first;
    columns = Math.min(columns, this._most);
    this.rows = 0;
    this._gaps(ring, first, to_s);
    if (count <= 2 * columns) {
      for (let k = first; k < ring.rows; k++) {
        const at = ring.at(k);
        this.x[this.rows] = ring.t_s[at] - to_s;
        for (let c = 0; c < this.y.length; c++) this.y[c][this.rows] = ring.values[c][at];
        this.rows++;
      }
      return;
    }
    // Columns stand still in time, so that a peak does not flicker as the picture moves.
    const wide_s = (to_s - from_s) / columns;
    let k = first;
    while (k < ring.rows && this.rows + 2 <= this.x.length) {
      const column = Math.floor(ring.t_s[ring.at(k)] / wide_s);
      let end = k + 1;
      while (end < ring.rows && Math.floor(ring.t_s[ring.at(end)] / wide_s) === column && !ring.gap_s[ring.at(end)]) end++;
      this._column(ring, k, end, to_s);
      k = end;
    }
  }

  /** @param {Ring} ring */
  _column(ring, /** @type {number} */ from, /** @type {number} */ to, /** @type {number} */ to_s) {
    const i = this.rows;
    this.x[i] = ring.t_s[ring.at(from)] - to_s;
    this.x[i + 1] = Math.max(ring.t_s[ring.at(to - 1)] - to_s, this.x[i] + 1e-6);
    for (let c = 0; c < this.y.length; c++) {
      const values = ring.values[c];
      let least = Infinity, most = -Infinity, least_k = 0, most_k = 0;
      for (let k = from; k < to; k++) {
        const v = values[ring.at(k)];
        if (v < least) (least = v), (least_k = k);
        if (v > most) (most = v), (most_k = k);
      }
      this.y[c][i] = least_k <= most_k ? least : most;
      this.y[c][i + 1] = least_k <= most_k ? most : least;
    }
    this.rows += 2;
  }

  /** @param {Ring} ring @param {number} first @param {number} to_s */
  _gaps(ring, first, to_s) {
    this.gap_count = 0;
    for (let k = first; k < ring.rows && 2 * this.gap_count + 2 <= this.gaps.length; k++) {
      const at = ring.at(k);
      const gap_s = ring.gap_s[at];
      if (!gap_s) continue;
      const from_s = k ? Math.max(ring.t_s[ring.at(k - 1)], ring.t_s[at] - gap_s - BREAK_S) : ring.t_s[at] - gap_s;
      this.gaps[2 * this.gap_count] = from_s - to_s;
      this.gaps[2 * this.gap_count + 1] = ring.t_s[at] - to_s;
      this.gap_count++;
    }
  }
}
