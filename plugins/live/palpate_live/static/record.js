// What the page knows: rows of the run, the older the coarser, and how things stand at a time.

const ROWS = 24000, ROWS_RECORDED = 240000;
export class Record {
  constructor(run) {
    this.run = run;
    this.size = run.recorded ? ROWS_RECORDED : ROWS;
    this.time = new Float64Array(this.size);
    this.columns = Array.from({ length: run.columns }, () => new Float32Array(this.size));
    this.count = 0;
    this.events = []; // of a recorded run: all of them, with their times
    this.applied = 0;
    this.reset();
  }

  reset() {
    this.applied = 0;
    this.state = { health: null, found: {}, flags: new Map(), guard: null, result: null };
  }

  append(time, columns) {
    let from = 0;
    while (from < time.length) {
      if (this.count === this.size) this.thin();
      const to = Math.min(time.length, from + this.size - this.count);
      this.time.set(time.subarray(from, to), this.count);
      this.columns.forEach((column, i) => column.set(columns[i].subarray(from, to), this.count));
      this.count += to - from;
      from = to;
    }
  }

  thin() { // of the older three quarters every second row goes
    const old = Math.floor(this.count * 3 / 4);
    for (const column of [this.time, ...this.columns]) {
      let to = 0;
      for (let i = 0; i < old; i += 2) column[to++] = column[i];
      column.copyWithin(to, old, this.count);
    }
    this.count -= Math.floor(old / 2);
  }

  get end() { return this.count ? this.time[this.count - 1] : 0; }

  rowsUntil(t) { // how many rows there are up to a time
    if (t >= this.end) return this.count;
    let low = 0, high = this.count;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.time[middle] <= t) low = middle + 1; else high = middle;
    }
    return low;
  }

  last(column, rows) { // the latest known value among the first rows: an estimate stays when contact ends
    const values = this.columns[column];
    for (let i = rows - 1; i >= 0; i--) if (!Number.isNaN(values[i])) return values[i];
    return NaN;
  }

  take(header) {
    if (this.run.recorded) this.events.push(header); else this.apply(header);
  }

  until(t) { // how things stood at a time
    if (!this.run.recorded) return this.state;
    if (this.applied && this.events[this.applied - 1].t > t) this.reset();
    while (this.applied < this.events.length && this.events[this.applied].t <= t) this.apply(this.events[this.applied++]);
    return this.state;
  }

  apply(message) {
    const state = this.state;
    if (message.kind === "found") state.found[message.track] = message;
    else if (message.kind === "flags") this.flags(message);
    else state[message.kind] = message;
  }

  flags({ track, flags, t }) {
    const now = new Set(flags.map((flag) => `${track ?? ""} ${flag.code}`));
    for (const [key, entry] of this.state.flags) if (entry.track === track && entry.until === null && !now.has(key)) entry.until = t;
    for (const flag of flags) {
      const key = `${track ?? ""} ${flag.code}`, known = this.state.flags.get(key);
      if (known && known.until === null) known.flag = flag;
      else this.state.flags.set(key, { track, flag, since: t, until: null });
    }
  }
}
