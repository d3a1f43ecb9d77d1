// Curves over time. One style for all: colours that everybody can distinguish, and a line style for each track.

export const COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#5b6570"];
const DASHES = [[], [6, 3], [2, 2], [8, 3, 2, 3]];
const INK = "#5b6570", GRID = { stroke: "#e6e9ec", width: 1 };
const HEIGHT = 190, MOST = 600;

export const style = (i) => ({ colour: COLOURS[i % COLOURS.length], dash: DASHES[i % DASHES.length] });

function pale(colour) {
  const part = (at) => parseInt(colour.slice(at, at + 2), 16);
  return `rgba(${part(1)},${part(3)},${part(5)},0.18)`;
}

function sample(colour, dash) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("width", 26); svg.setAttribute("height", 8);
  const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
  for (const [key, value] of Object.entries({ x1: 0, x2: 26, y1: 4, y2: 4, stroke: colour, "stroke-width": 2, "stroke-dasharray": dash.join(" ") }))
    line.setAttribute(key, value);
  svg.append(line);
  return svg;
}

// The rows that are drawn: those of a stretch of time, at most so many.
export function chosen(record, from, to) {
  let first = from > 0 ? record.rowsUntil(from) : 0;
  const last = record.rowsUntil(to);
  first = Math.max(Math.min(first, last - 1), 0);
  const step = Math.max(Math.ceil((last - first) / MOST), 1), rows = [];
  for (let i = first - (first % step); i < last; i += step) rows.push(i);
  return rows;
}

export class Chart {
  // series: { label, colour, dash, value(row), low?(row), high?(row) }, each in the unit that is shown
  constructor(parent, { title, series, lines = [], least = 0, robust = false }) {
    Object.assign(this, { series, lines, least, robust, seen: true, range: [0, 1], x: [0, 1] });
    this.box = document.createElement("div");
    this.box.className = "chart";
    const legend = document.createElement("div");
    legend.className = "legend";
    for (const one of series) {
      const entry = document.createElement("span");
      entry.append(sample(one.colour, one.dash), one.label);
      legend.append(entry);
    }
    const head = document.createElement("h2");
    head.textContent = title;
    this.place = document.createElement("div");
    this.box.append(legend, head, this.place);
    parent.append(this.box);
    this.plot = null;
    new IntersectionObserver(([entry]) => { this.seen = entry.isIntersecting; }).observe(this.box);
    new ResizeObserver(() => this.plot?.setSize({ width: this.width, height: HEIGHT })).observe(this.box);
  }

  get width() { return Math.max(this.box.clientWidth - 28, 200); }

  make(data) {
    const series = [{}], bands = [];
    for (const one of this.series) {
      series.push({ stroke: one.colour, width: 1, dash: one.dash, points: { show: false }, spanGaps: false });
      if (one.low) {
        series.push({ stroke: "transparent", points: { show: false } }, { stroke: "transparent", points: { show: false } });
        bands.push({ series: [series.length - 1, series.length - 2], fill: pale(one.colour) });
      }
    }
    const axis = { stroke: INK, grid: GRID, ticks: GRID, font: "12px system-ui, sans-serif" };
    const options = {
      width: this.width, height: HEIGHT, series, bands,
      legend: { show: false }, cursor: { show: false },
      scales: { x: { time: false, range: () => this.x }, y: { range: () => this.range } },
      axes: [{ ...axis, size: 28, values: (u, ticks) => ticks.map((t) => `${+t.toFixed(3)} s`) }, { ...axis, size: 62 }],
      hooks: { drawAxes: [(u) => this.mark(u)] },
    };
    this.plot = new uPlot(options, data, this.place);
  }

  mark(u) {
    u.ctx.save();
    u.ctx.strokeStyle = INK;
    u.ctx.setLineDash([3, 3]);
    for (const at of this.lines) {
      const y = Math.round(u.valToPos(at, "y", true));
      if (y < u.bbox.top || y > u.bbox.top + u.bbox.height) continue;
      u.ctx.beginPath(); u.ctx.moveTo(u.bbox.left, y); u.ctx.lineTo(u.bbox.left + u.bbox.width, y); u.ctx.stroke();
    }
    u.ctx.restore();
  }

  draw(record, rows, from, to) {
    if (!this.seen || !rows.length) return;
    const data = [rows.map((row) => record.time[row])];
    const spans = [];
    for (const one of this.series) {
      const values = column(rows, one.value);
      data.push(values);
      spans.push(span(values, this.robust));
      if (one.low) data.push(column(rows, one.low), column(rows, one.high));
    }
    this.x = [from, Math.max(to, from + 1e-3)];
    this.range = union(spans, this.lines, this.least, this.robust);
    if (this.plot) this.plot.setData(data); else this.make(data);
  }
}

function column(rows, value) {
  const found = new Array(rows.length);
  for (let i = 0; i < rows.length; i++) {
    const v = value(rows[i]);
    found[i] = v === v && Math.abs(v) < 1e30 ? v : null;
  }
  return found;
}

// Lowest, middle and highest of a curve. Of a robust one what is rare is left out, above all where it begins: there a
// filter finds its way.
function span(values, robust) {
  const sorted = (some) => some.filter((v) => v !== null).sort((a, b) => a - b);
  const at = (known, share) => known[Math.min(Math.floor(share * known.length), known.length - 1)];
  if (!robust) {
    let low = Infinity, high = -Infinity;
    for (const v of values) if (v !== null) { if (v < low) low = v; if (v > high) high = v; }
    return low <= high ? [low, (low + high) / 2, high] : null;
  }
  const all = sorted(values);
  if (!all.length) return null;
  const first = values.findIndex((v) => v !== null), late = sorted(values.slice(first + Math.floor((values.length - first) / 3)));
  if (!late.length) return [at(all, 0.1), at(all, 0.5), at(all, 0.9)];
  return [Math.min(at(all, 0.1), at(late, 0.01)), at(late, 0.5), Math.max(at(all, 0.9), at(late, 0.99))];
}

// What the axis shows: curves far from all others flatten nobody.
function union(spans, lines, least, robust) {
  let known = spans.filter((s) => s);
  if (!known.length) return [0, 1];
  if (robust && known.length > 1) {
    const middles = known.map((s) => s[1]).sort((a, b) => a - b), middle = middles[Math.floor((middles.length - 1) / 2)];
    known = known.filter((s) => Math.abs(s[1] - middle) <= 4 * Math.abs(middle) + least);
  }
  let low = Math.min(...known.map((s) => s[0]), ...lines), high = Math.max(...known.map((s) => s[2]), ...lines);
  const pad = Math.max((robust ? 0.2 : 0.08) * (high - low), robust ? 0.03 * Math.abs(high + low) / 2 : 0, least / 2, 1e-12);
  return [low - pad, high + pad];
}
