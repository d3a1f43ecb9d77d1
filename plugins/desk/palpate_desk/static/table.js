// The table of curves: only the rows in sight are in the page.
const HEIGHT = 26, BEYOND = 8;
const SIGNS = { good: "●", doubtful: "◐", invalid: "✕" };
const MARKS = { good: "✓", bad: "✗", none: "" };

export class Table {
  constructor(head, box, chosen) {
    Object.assign(this, { head, box, chosen, rows: [], shown: [], names: null, picked: -1, key: null, down: false, values: [], units: {} });
    this.space = document.createElement("div");
    this.space.className = "space";
    box.append(this.space);
    box.addEventListener("scroll", () => this.draw());
    box.addEventListener("click", (event) => { const row = event.target.closest(".row"); if (row) this.pick(Number(row.dataset.at)); });
    new ResizeObserver(() => this.draw()).observe(box);
  }

  columns(values, units, residual) {
    Object.assign(this, { values, units, residual });
    for (const part of [this.head, this.box]) part.style.setProperty("--values", values.length);
    const heads = [["mark", ""], ["curve", "curve"], ...values.map((name) => [name, `${name.replaceAll("_", " ")}\n${units[name]}`]), ["rms", `RMS\n${this.residual}`]];
    this.head.replaceChildren(...heads.map(([key, text]) => {
      const button = document.createElement("button");
      button.type = "button"; button.textContent = text || "✓✗"; button.title = `sort by ${key}`;
      button.addEventListener("click", () => this.sort(key));
      return button;
    }));
  }

  fill(rows) {
    this.rows = rows;
    const names = rows.map((row) => row.curve);
    let length = names.length > 1 ? names[0].lastIndexOf("/") + 1 : 0;
    while (length && names.some((name) => !name.startsWith(names[0].slice(0, length)))) length = names[0].lastIndexOf("/", length - 2) + 1;
    this.common = length; // characters that all names begin with, which are not shown
    this.arrange();
  }

  short(name) { return name.slice(this.common ?? 0); }

  replace(rows) {
    const by = new Map();
    for (const row of rows) by.set(row.curve, [...(by.get(row.curve) ?? []), row]);
    const found = [];
    for (const row of this.rows) {
      const anew = by.get(row.curve);
      if (anew === undefined) found.push(row);
      else { found.push(...anew); by.set(row.curve, []); }
    }
    this.rows = found;
    this.arrange();
  }

  sort(key) { this.down = this.key === key ? !this.down : false; this.key = key; this.arrange(); }

  filter(names) { this.names = names && new Set(names); this.arrange(); }

  arrange() {
    const kept = this.current;
    this.shown = this.names ? this.rows.filter((row) => this.names.has(row.curve)) : this.rows.slice();
    if (this.key) {
      const value = (row) => row.values[this.key]?.[0] ?? row[this.key] ?? null, sign = this.down ? -1 : 1;
      this.shown.sort((a, b) => {
        const x = value(a), y = value(b);
        if (x === null || y === null) return (x === null) - (y === null);
        return sign * (typeof x === "number" ? x - y : String(x).localeCompare(String(y), undefined, { numeric: true }));
      });
    }
    const at = kept ? this.shown.findIndex((row) => row.curve === kept.curve && row.track === kept.track) : -1;
    this.picked = at >= 0 ? at : kept ? this.shown.findIndex((row) => row.curve === kept.curve) : -1;
    this.space.style.height = `${HEIGHT * this.shown.length}px`;
    this.box.setAttribute("aria-rowcount", this.shown.length);
    this.draw();
  }

  // Number and verdict of a value; of a row that is not current the number and its state.
  value(row, name) {
    const known = row.state === "current", word = known ? row.verdicts[name] ?? "" : row.state;
    const text = row.values[name]?.[2] ?? (known ? (row.error ? "not read" : "-") : row.state);
    return [`${known ? SIGNS[word] ?? "?" : "○"} ${text}`, known ? word : "", word];
  }

  get current() { return this.shown[this.picked] ?? null; }

  pick(at) {
    if (!this.shown.length) return;
    this.picked = Math.min(Math.max(at, 0), this.shown.length - 1);
    const top = HEIGHT * this.picked, box = this.box;
    if (top < box.scrollTop) box.scrollTop = top;
    else if (top + HEIGHT > box.scrollTop + box.clientHeight) box.scrollTop = top + HEIGHT - box.clientHeight;
    this.draw();
    this.chosen(this.current);
  }

  pickCurve(name) { const at = this.shown.findIndex((row) => row.curve === name); if (at >= 0) this.pick(at); }

  next(holds) {
    for (let step = 1; step <= this.shown.length; step++) {
      const at = (this.picked + step) % this.shown.length;
      if (holds(this.shown[at])) { this.pick(at); return true; }
    }
    return false;
  }

  draw() {
    const first = Math.max(Math.floor(this.box.scrollTop / HEIGHT) - BEYOND, 0);
    const last = Math.min(Math.ceil((this.box.scrollTop + this.box.clientHeight) / HEIGHT) + BEYOND, this.shown.length);
    const found = [];
    for (let at = first; at < last; at++) found.push(this.row(this.shown[at], at));
    this.box.replaceChildren(this.space, ...found);
    const picked = found.find((row) => row.getAttribute("aria-selected") === "true");
    if (picked) this.box.setAttribute("aria-activedescendant", picked.id); else this.box.removeAttribute("aria-activedescendant");
  }

  row(row, at) {
    const line = document.createElement("div");
    line.className = `row ${row.state} mark-${row.mark}`;
    line.id = `row-${at}`; line.dataset.at = at; line.style.top = `${HEIGHT * at}px`;
    line.setAttribute("role", "row"); line.setAttribute("aria-rowindex", at + 1);
    line.setAttribute("aria-selected", at === this.picked);
    const cells = [[MARKS[row.mark], ""], [row.curve, "name"], ...this.values.map((name) => this.value(row, name)), [row.rms ?? "-", ""]];
    for (const [text, name, title] of cells) {
      const cell = document.createElement("span");
      cell.setAttribute("role", "gridcell"); cell.className = name; cell.textContent = text; cell.title = title ?? "";
      if (name === "name") { cell.title = row.curve; const inner = document.createElement("bdi"); inner.textContent = this.short(row.curve); cell.replaceChildren(inner); }
      line.append(cell);
    }
    return line;
  }
}
