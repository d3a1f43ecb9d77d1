// One curve: force over depth and over time, residual; a range by dragging over time.
import { COLOURS } from "./charts.js";

const SMALL = 230, LOW = 130, BAND = `${COLOURS[0]}38`;
const dark = matchMedia("(prefers-color-scheme: dark)");

const known = (column) => Array.from(column, (v) => (v === v ? v : null));

function axes(x, y) {
  const ink = dark.matches ? "#aab4bd" : "#5b6570", grid = { stroke: dark.matches ? "#2c343b" : "#e6e9ec", width: 1 };
  const axis = { stroke: ink, grid, ticks: grid, font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif", labelSize: 16 };
  return [{ ...axis, label: x, size: 34 }, { ...axis, label: y, size: 56, space: 24 }];
}

export class CurveView {
  constructor(places, busy, ranged) {
    Object.assign(this, { places, busy, ranged, plots: [], drawn: 0, answer: null, points: 0 });
    new ResizeObserver(() => { for (const plot of this.plots) plot.setSize({ width: this.width(plot.box), height: plot.height }); }).observe(places.depth);
    dark.addEventListener("change", () => this.answer && this.show(this.answer, this.second));
  }

  width(box) { return Math.max(box.clientWidth, 220); }

  // second: { name, model }, the force of another model at the same times, or null
  show(answer, second = null) {
    Object.assign(this, { answer, second });
    for (const plot of this.plots) plot.destroy();
    const { places } = this, { header, time, columns } = answer;
    const [height, force, model] = header.columns.map((_, k) => known(columns[k] ?? [])); // of a file that has gone, none
    const surface = header.raw ? null : header.surface, depth = height.map((z) => (z === null ? null : 1e3 * (surface === null ? z : surface - z)));
    const seconds = Array.from(time), less = (modelled) => force.map((f, i) => (f === null || modelled[i] === null ? null : f - modelled[i]));
    this.points = seconds.length;
    const over = surface === null ? "height as read [mm]" : "depth [mm]", measured = { values: force, colour: dark.matches ? "#9fb3c4" : "#5b6570", width: 1.5 };
    const modelled = { values: model, colour: COLOURS[1], width: 2 }, rest = { ...measured, values: less(model) };
    const other = second ? [{ values: known(second.model), colour: COLOURS[2], width: 2, dash: [6, 4] }] : [], otherRest = other.map((curve) => ({ ...curve, width: 1.5, values: less(curve.values) }));
    this.plots = [this.plot(places.depth, SMALL, over, "force [N]", depth, [measured, modelled, ...other])];
    this.settle();
    this.drawn += 1;
    if (!places.time) return; // below a map
    places.residual.parentElement.hidden = header.raw;
    this.plots.push(
      this.plot(places.time, SMALL, "time [s]", "force [N]", seconds, [measured, modelled], true),
      this.plot(places.residual, LOW, "time [s]", "N", seconds, [rest, ...otherRest, ...band(header.noise, seconds.length)]),
    );
    const told = header.noise ? `; band: ± ${(1e3 * header.noise).toPrecision(3)} mN, the standard deviation of the force before contact` : header.raw ? "" : "; no band: too few samples before contact give the noise";
    places.residual.previousElementSibling.textContent = `residual: measured less modelled force${told}`;
    this.legend(second?.name);
  }

  legend(name) {
    for (const box of [this.places.depth, this.places.residual]) {
      const line = document.createElement("span");
      line.className = "second"; line.style.color = COLOURS[2]; line.textContent = name ? ` - - - ${name}` : "";
      box.previousElementSibling.querySelector(".second")?.remove();
      box.previousElementSibling.append(line);
    }
  }

  // curves: { values, colour, width, dash? }; the last two, where they have no width, are the edges of a band
  plot(box, height, x, y, xs, curves, ranged = false) {
    const path = x.startsWith("depth") || x.startsWith("height") ? { paths: line, points: { show: false } } : { points: { show: false } };
    const data = [xs, ...curves.map((curve) => curve.values)], last = curves.length, bands = curves[last - 1].width ? [] : [{ series: [last - 1, last], fill: BAND }];
    const series = [{}, ...curves.map(({ colour, width, dash }) => ({ stroke: colour, width, dash, ...path }))];
    const options = {
      width: this.width(box), height, series, bands, axes: axes(x, y), legend: { show: false },
      scales: { x: { time: false, range: (u, low, high) => (low < high ? [low, high] : [low - 1, high + 1]) } },
      cursor: { y: false, drag: { x: ranged, y: false, setScale: false } },
      hooks: ranged ? { setSelect: [(u) => this.select(u)] } : {},
    };
    // Over depth the points come in the order of time, and x is not sorted: the plot gets the range of x as well.
    if (path.paths) {
      const places = data[0].filter((v) => v !== null), low = Math.min(...places), high = Math.max(...places);
      options.scales.x.range = () => (low < high ? [low - 0.02 * (high - low), high + 0.02 * (high - low)] : [low - 1, low + 1]);
      options.cursor = { show: false };
      options.scales.y = { range: () => span(data.slice(1)) };
      options.scales.x.distr = 1;
      options.series[0] = { sorted: 0 };
      const plot = new uPlot(options, data, box);
      return Object.assign(plot, { box, height });
    }
    return Object.assign(new uPlot(options, data, box), { box, height });
  }

  select(u) {
    if (u.select.width < 3) return;
    const from = u.posToVal(u.select.left, "x"), to = u.posToVal(u.select.left + u.select.width, "x");
    this.ranged(`${+from.toFixed(4)} s..${+to.toFixed(4)} s`);
  }

  fade() { for (const box of Object.values(this.places)) box.classList.add("pale"); this.busy.hidden = false; }

  settle() { for (const box of Object.values(this.places)) box.classList.remove("pale"); this.busy.hidden = true; }
}

// Upper and lower edge of the noise.
function band(noise, count) {
  return noise ? [noise, -noise].map((value) => ({ values: new Array(count).fill(value), colour: "transparent", width: 0 })) : [];
}

function span(columns) {
  let low = Infinity, high = -Infinity;
  for (const column of columns) for (const v of column) if (v !== null) { if (v < low) low = v; if (v > high) high = v; }
  const pad = 0.05 * (high - low) || 1;
  return low <= high ? [low - pad, high + pad] : [0, 1];
}

// A line through points whose x goes back and forth.
function line(u, at) {
  const path = new Path2D(), [xs, ys] = [u.data[0], u.data[at]];
  let pen = false;
  for (let i = 0; i < xs.length; i++) {
    if (xs[i] === null || ys[i] === null) { pen = false; continue; }
    const x = u.valToPos(xs[i], "x", true), y = u.valToPos(ys[i], "y", true);
    if (pen) path.lineTo(x, y); else path.moveTo(x, y);
    pen = true;
  }
  return { stroke: path, fill: null, clip: null, band: null, gaps: null, flags: 0 };
}
