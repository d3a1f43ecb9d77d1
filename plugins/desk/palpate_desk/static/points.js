// Values by group and by place: a point for each curve, rejected ones hollow. A click on a point shows its curve.
import { COLOURS } from "./charts.js";

const WIDE = 640, HIGH = 300, LOW = 200, LEFT = 60, FOOT = 40, MAP_WIDE = 560, MAP_HIGH = 420;

function node(name, attributes, text) {
  const found = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) found.setAttribute(key, value);
  if (text !== undefined) found.textContent = text;
  return found;
}

const quantile = (sorted, share) => {
  const at = share * (sorted.length - 1), low = Math.floor(at);
  return sorted[low] + (at - low) * ((sorted[low + 1] ?? sorted[low]) - sorted[low]);
};

// The next of 1, 2, 5, 10, ...
function rounded(rough) {
  const power = 10 ** Math.floor(Math.log10(rough));
  return [1, 2, 5, 10].map((k) => k * power).find((step) => step >= rough);
}

function ticks(low, high, count = 5) {
  const step = rounded((high - low) / count), found = [];
  for (let v = Math.ceil(low / step) * step; v <= high + 1e-9 * step; v += step) found.push(+v.toPrecision(12));
  return found;
}

export function drawGroups(box, rows, by, name, unit, show) {
  const groups = new Map();
  for (const row of rows) {
    const value = row.values[name]?.[0];
    if (value === undefined) continue;
    const group = by ? row.groups[by] || "none" : "curves";
    groups.set(group, [...(groups.get(group) ?? []), { row, value }]);
  }
  const all = [...groups.values()].flat().map((one) => one.value);
  box.replaceChildren();
  if (!all.length) return 0;
  const low = Math.min(...all), high = Math.max(...all), pad = 0.08 * (high - low) || Math.abs(high) || 1;
  const y = (v) => HIGH - FOOT - ((v - low + pad) / (high - low + 2 * pad)) * (HIGH - FOOT - 10);
  const svg = node("svg", { viewBox: `0 0 ${WIDE} ${HIGH}`, class: "points", role: "img", "aria-label": `${name} by ${by || "curve"}` });
  for (const v of ticks(low - pad, high + pad)) svg.append(node("line", { x1: LEFT, x2: WIDE, y1: y(v), y2: y(v), opacity: 0.3 }), node("text", { x: LEFT - 6, y: y(v) + 4, "text-anchor": "end" }, v));
  svg.append(node("text", { x: 4, y: 12 }, `${name} [${unit}]`));
  const names = [...groups.keys()].sort((a, b) => a.localeCompare(b, undefined, { numeric: true })), step = (WIDE - LEFT) / names.length;
  names.forEach((group, i) => {
    const points = groups.get(group), centre = LEFT + (i + 0.5) * step, colour = COLOURS[i % COLOURS.length];
    const used = points.filter((p) => p.row.mark !== "bad").map((p) => p.value).sort((a, b) => a - b);
    if (used.length > 1) {
      const [a, b, c] = [0.25, 0.5, 0.75].map((share) => y(quantile(used, share))), half = Math.min(step / 4, 40);
      svg.append(node("rect", { x: centre - half, y: c, width: 2 * half, height: Math.max(a - c, 1), fill: "none", stroke: colour }), node("line", { x1: centre - half, x2: centre + half, y1: b, y2: b, "stroke-width": 2 }));
    }
    points.forEach((p, k) => {
      const x = centre + ((((k * 37) % 21) - 10) / 21) * Math.min(step / 2, 80), bad = p.row.mark === "bad";
      const dot = node("circle", { cx: x, cy: y(p.value), r: 4, fill: bad ? "none" : colour, stroke: colour, "data-curve": p.row.curve });
      dot.append(node("title", {}, `${p.row.curve}: ${p.row.values[name][2]} ${unit}${bad ? `, rejected: ${p.row.reason}` : ""}`));
      dot.addEventListener("click", () => show(p.row.curve));
      svg.append(dot);
    });
    svg.append(node("text", { x: centre, y: HIGH - FOOT + 18, "text-anchor": "middle" }, `${group} (${used.length})`));
  });
  box.append(svg);
  return all.length;
}

// How many curves have a value in each stretch, over all that are shown; of each bar the hollow part is rejected.
export function drawHistogram(box, rows, name, unit) {
  const known = rows.filter((row) => row.values[name]).map((row) => ({ value: row.values[name][0], bad: row.mark === "bad" }));
  box.replaceChildren();
  if (known.length < 2) return;
  const values = known.map((one) => one.value), low = Math.min(...values), high = Math.max(...values);
  const step = high > low ? rounded((high - low) / (2 * Math.cbrt(known.length))) : Math.abs(low) || 1; // Rice's rule
  const first = Math.floor(low / step), count = Math.floor(high / step) - first + 1;
  const bars = Array.from({ length: count }, () => ({ used: 0, bad: 0 }));
  for (const { value, bad } of known) bars[Math.min(Math.max(Math.floor(value / step) - first, 0), count - 1)][bad ? "bad" : "used"] += 1;
  const most = Math.max(...bars.map((bar) => bar.used + bar.bad)), wide = (WIDE - LEFT - 10) / count;
  const x = (i) => LEFT + i * wide, y = (n) => LOW - FOOT - (n / most) * (LOW - FOOT - 22);
  const svg = node("svg", { viewBox: `0 0 ${WIDE} ${LOW}`, class: "points", role: "img", "aria-label": `histogram of ${name}` });
  svg.append(node("text", { x: 4, y: 12 }, `curves by ${name} [${unit}]`));
  for (const n of ticks(0, most, 3).filter(Number.isInteger)) svg.append(node("line", { x1: LEFT, x2: WIDE, y1: y(n), y2: y(n), opacity: 0.3 }), node("text", { x: LEFT - 6, y: y(n) + 4, "text-anchor": "end" }, n));
  bars.forEach(({ used, bad }, i) => {
    const from = +((first + i) * step).toPrecision(12), to = +((first + i + 1) * step).toPrecision(12);
    for (const [kind, bottom, top, fill] of [["used", 0, used, COLOURS[0]], ["rejected", used, used + bad, "none"]]) {
      if (top === bottom) continue;
      const bar = node("rect", { x: x(i) + 1, width: Math.max(wide - 2, 1), y: y(top), height: y(bottom) - y(top), fill, stroke: COLOURS[0], "data-kind": kind, "data-count": top - bottom });
      bar.append(node("title", {}, `${top - bottom} ${kind}, from ${from} up to ${to} ${unit}`));
      svg.append(bar);
    }
    if (i % Math.ceil(count / 10) === 0) svg.append(node("text", { x: x(i), y: LOW - FOOT + 16, "text-anchor": "middle" }, from));
  });
  box.append(svg);
}

// The usual distance from one line of places to the next along an axis; 0 for a single line.
function lineStep(values) {
  const sorted = [...values].sort((a, b) => a - b), extent = sorted[sorted.length - 1] - sorted[0];
  const gaps = sorted.slice(1).map((v, i) => v - sorted[i]).filter((gap) => gap > 1e-3 * extent).sort((a, b) => a - b);
  return gaps.length ? gaps[gaps.length >> 1] : 0;
}

// The places of the curves, shaded by a value; a cross has none. The curve under the cursor is reported, and the edges
// of a dragged rectangle [mm], x then y.
export function drawSites(box, rows, name, unit, show, dragged, over) {
  const placed = rows.filter((row) => row.place), valued = placed.filter((row) => row.values[name]);
  box.replaceChildren();
  if (!valued.length) return 0;
  const xs = placed.map((row) => 1e3 * row.place[0]), ys = placed.map((row) => 1e3 * row.place[1]), vs = valued.map((row) => row.values[name][0]);
  const steps = [lineStep(xs), lineStep(ys)], step = Math.min(...steps.filter((one) => one > 0)), margin = Number.isFinite(step) ? step / 2 : 1;
  const ends = (values) => { const lowest = Math.min(...values), highest = Math.max(...values), pad = Math.max(0.08 * (highest - lowest), margin); return [lowest - pad, highest + pad]; };
  const [x0, x1] = ends(xs), [y0, y1] = ends(ys), good = valued.filter((row) => row.mark !== "bad").map((row) => row.values[name][0]);
  const [low, high] = good.length ? [Math.min(...good), Math.max(...good)] : [Math.min(...vs), Math.max(...vs)];
  const [length, per] = Math.max(x1 - x0, y1 - y0) > 0.5 ? ["mm", 1] : ["um", 1e3];
  const scale = Math.min((MAP_WIDE - LEFT - 10) / (x1 - x0), (MAP_HIGH - FOOT - 10) / (y1 - y0));
  const x = (v) => LEFT + (v - x0) * scale, y = (v) => MAP_HIGH - FOOT - (v - y0) * scale;
  const svg = node("svg", { viewBox: `0 0 ${MAP_WIDE} ${MAP_HIGH}`, class: "points", role: "img", "aria-label": `${name} at the places of the curves` });
  for (const v of ticks(per * x0, per * x1)) svg.append(node("text", { x: x(v / per), y: MAP_HIGH - FOOT + 16, "text-anchor": "middle" }, v));
  for (const v of ticks(per * y0, per * y1)) svg.append(node("text", { x: LEFT - 8, y: y(v / per) + 4, "text-anchor": "end" }, v));
  svg.append(node("text", { x: LEFT, y: MAP_HIGH - 8 }, `x and y [${length}]; ${name} from ${low.toPrecision(4)} (pale) to ${high.toPrecision(4)} ${unit}`));
  // Places nearer than two dots are cells, as wide as from one to the next.
  const side = scale * margin, dense = side < 9, [wide, tall] = steps.map((one) => scale * (one || 2 * margin));
  placed.forEach((row, i) => {
    const value = row.values[name], share = value && high > low ? Math.min(Math.max((value[0] - low) / (high - low), 0), 1) : 1, bad = row.mark === "bad";
    const paint = { fill: bad || !value ? "none" : "#0072b2", "fill-opacity": 0.15 + 0.85 * share, stroke: bad ? "#d55e00" : "#0072b2", "pointer-events": "all", "data-curve": row.curve };
    const cell = dense ? node("rect", { x: x(xs[i]) - wide / 2, y: y(ys[i]) - tall / 2, width: wide, height: tall, ...paint, "stroke-width": value && !bad ? 0 : 1 }) : node("circle", { cx: x(xs[i]), cy: y(ys[i]), r: 9, ...paint });
    cell.append(node("title", {}, value ? `${row.curve}: ${value[2]} ${unit}${bad ? `, rejected: ${row.reason}` : ""}` : `${row.curve}: ${row.error || row.verdicts[name] || "not fitted"}`));
    cell.addEventListener("click", () => show(row.curve));
    cell.addEventListener("pointerenter", () => over(row.curve));
    svg.append(cell);
    if (!value) svg.append(node("text", { x: x(xs[i]), y: y(ys[i]) + 4, "text-anchor": "middle", "pointer-events": "none" }, "×"));
  });
  box.append(svg);
  drag(svg, (left, right, top, bottom) => dragged([x0 + (left - LEFT) / scale, x0 + (right - LEFT) / scale], [y0 + (MAP_HIGH - FOOT - bottom) / scale, y0 + (MAP_HIGH - FOOT - top) / scale]));
  return valued.length;
}

// A rectangle in the units of the picture, once the mouse is let go; a click is not one.
function drag(svg, told) {
  const frame = node("rect", { class: "drag", fill: COLOURS[0], "fill-opacity": 0.15, stroke: COLOURS[0] });
  let from = null;
  const place = (event) => { const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse()); return [at.x, at.y]; };
  const edges = ([x, y]) => [Math.min(from[0], x), Math.max(from[0], x), Math.min(from[1], y), Math.max(from[1], y)];
  const large = ([left, right, top, bottom]) => right - left > 4 && bottom - top > 4;
  svg.addEventListener("pointerdown", (event) => { if (event.button === 0) { from = place(event); event.preventDefault(); } });
  svg.addEventListener("pointermove", (event) => {
    if (!from) return;
    const found = edges(place(event)), [left, right, top, bottom] = found;
    if (!large(found)) { frame.remove(); return; }
    if (!frame.parentNode) { svg.append(frame); svg.setPointerCapture(event.pointerId); }
    for (const [key, value] of Object.entries({ x: left, y: top, width: right - left, height: bottom - top })) frame.setAttribute(key, value);
  });
  svg.addEventListener("pointerup", (event) => {
    const found = from && edges(place(event));
    from = null;
    frame.remove();
    if (found && large(found)) told(...found);
  });
  svg.addEventListener("pointercancel", () => { from = null; frame.remove(); });
}
