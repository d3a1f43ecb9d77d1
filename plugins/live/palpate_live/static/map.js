// The map as it fills: means over cells of a raster, or along the line of a sweep.
import { COLOURS } from "./charts.js";
import { colour, meansOnSkin } from "./skin.js";

const CELLS = 48, ALONG = 160, APART = 2e-3; // [m] between places, from which on there is something to map
function box(record, rows, extent) {
  if (extent) return [[extent[0][0], extent[1][0]], [extent[0][1], extent[1][1]]];
  return [2, 3].map((k) => {
    let low = Infinity, high = -Infinity;
    for (let i = 0; i < rows; i++) { const v = record.columns[k][i]; if (v < low) low = v; if (v > high) high = v; }
    return [low, high];
  });
}

function means(record, rows, column, ranges, cells) {
  const sum = new Float64Array(cells[0] * cells[1]), count = new Uint32Array(sum.length), values = record.columns[column];
  for (let i = 0; i < rows; i++) {
    const v = values[i];
    if (v !== v) continue;
    let cell = 0, inside = true;
    for (const k of [1, 0]) {
      const [low, high] = ranges[k], at = cells[k] === 1 ? 0 : Math.floor((record.columns[2 + k][i] - low) / (high - low) * cells[k]);
      if (!(at >= 0 && at <= cells[k])) inside = false;
      cell = cell * cells[k] + Math.min(at, cells[k] - 1);
    }
    if (inside) { sum[cell] += v; count[cell]++; }
  }
  return Array.from(sum, (s, i) => (count[i] ? s / count[i] : NaN));
}

export function drawMap(record, rows, column, { unit, factor, name }, canvas, note) {
  const ranges = box(record, rows, record.run.extent), wide = ranges.map(([low, high]) => high - low);
  const moves = wide.map((w) => w > APART);
  canvas.hidden = !moves.some(Boolean);
  if (canvas.hidden) { note.textContent = "The tip stays in one place: there is nothing to map."; return; }
  const line = moves.filter(Boolean).length === 1, along = moves[0] ? 0 : 1;
  const cells = [0, 1].map((k) => !moves[k] ? 1 : line ? ALONG : Math.max(Math.round(CELLS * Math.min(1, wide[k] / Math.max(...wide))), 4));
  const found = means(record, rows, column, ranges, cells), known = found.filter((v) => v === v).sort((a, b) => a - b);
  if (!known.length) { note.textContent = "No estimates yet."; canvas.hidden = true; return; }
  const [low, high] = ends(known, factor);
  const axis = (k) => `${"xy"[k]} from ${(1e3 * ranges[k][0]).toFixed(1)} to ${(1e3 * ranges[k][1]).toFixed(1)} mm`;
  const filled = `${Math.round(100 * known.length / found.length)} % of the cells are filled`;
  const scale = `${name} ${low.toPrecision(4)} to ${high.toPrecision(4)} ${unit}`;
  if (line) { drawLine(canvas, found.map((v) => v * factor), low, high); note.textContent = `${axis(along)}; ${scale}; ${filled}`; return; }
  note.textContent = `${axis(0)} (right), ${axis(1)} (up); ${scale} (dark to bright); ${filled}`;
  const size = Math.max(Math.floor(420 / Math.max(...cells)), 2);
  canvas.width = cells[0] * size; canvas.height = cells[1] * size;
  const g = canvas.getContext("2d");
  g.fillStyle = "#eef1f3"; g.fillRect(0, 0, canvas.width, canvas.height);
  found.forEach((v, i) => {
    if (v !== v) return;
    g.fillStyle = colour((v * factor - low) / (high - low || 1));
    g.fillRect((i % cells[0]) * size, canvas.height - (Math.floor(i / cells[0]) + 1) * size, size, size);
  });
}

function ends(sorted, factor) { // between which colours go
  return [Math.floor(0.03 * (sorted.length - 1)), Math.ceil(0.97 * (sorted.length - 1))].map((i) => sorted[i] * factor);
}

export function showOnSkin(view, record, rows, column, { unit, factor, name }) {
  const { skin, lumps } = record.run, [height, x, y, values] = [1, 2, 3, column].map((k) => record.columns[k]);
  const means = meansOnSkin(skin, (i) => [x[i], y[i], height[i], values[i]], rows);
  const [low, high] = ends(means.filter((v) => v !== null).sort((a, b) => a - b), factor);
  if (low === undefined || !(low === low)) return;
  view.show(skin, { values: means.map((v) => (v === null ? null : v * factor)), low, high, label: `${name}, ${unit}`, lumps });
}

function drawLine(canvas, values, low, high) {
  const width = canvas.width = Math.min(canvas.parentElement.clientWidth - 30, 1100), height = canvas.height = 180;
  const g = canvas.getContext("2d"), pad = 0.1 * (high - low || 1), bottom = low - pad, top = high + pad;
  g.clearRect(0, 0, width, height);
  g.strokeStyle = "#d7dce1"; g.strokeRect(0.5, 0.5, width - 1, height - 1);
  g.fillStyle = COLOURS[0];
  values.forEach((v, i) => {
    if (v === v) g.fillRect(width * (i + 0.5) / values.length - 2, height * (1 - (v - bottom) / (top - bottom)) - 2, 4, 4);
  });
}
