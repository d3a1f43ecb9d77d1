// A map on a surface that turns, by mouse, finger and arrow keys: cells in the colours of their values, lumps outlined.
const SCALE = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]]; // viridis, from low to high
const INK = "#1b1f24", GREY = [201, 208, 214], INSIDE = "#e3e8eb", LUMP = "#d01c1c";
const WIDE = 1120, HIGH = 800, FOOT = 110, STEP = Math.PI / 36, BEGIN = [-0.5, 0.7]; // azimuth and elevation [rad]

export function colour(share) {
  const at = Math.min(Math.max(share, 0), 1) * (SCALE.length - 1), i = Math.min(Math.floor(at), SCALE.length - 2), f = at - i;
  return `rgb(${SCALE[i].map((c, k) => Math.round(c + f * (SCALE[i + 1][k] - c))).join(",")})`;
}

// The skin over a grid in x and y: {x: [from, to, count], y, z: [count] in mm, null where it is not known}.
export class SkinView {
  constructor(canvas) {
    this.canvas = canvas;
    [this.azimuth, this.elevation] = BEGIN;
    canvas.width = WIDE; canvas.height = HIGH;
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "application");
    canvas.style.touchAction = "none";
    canvas.style.cursor = "grab";
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      if (event.buttons) this.turn(event.movementX / 120, event.movementY / 120);
    });
    canvas.addEventListener("keydown", (event) => {
      const by = { ArrowLeft: [-STEP, 0], ArrowRight: [STEP, 0], ArrowUp: [0, -STEP], ArrowDown: [0, STEP] }[event.key];
      if (by) this.turn(...by);
      else if (event.key === "Home") { [this.azimuth, this.elevation] = BEGIN; this.turn(0, 0); }
      else return;
      event.preventDefault();
    });
  }

  turn(right, down) {
    this.azimuth += right;
    this.elevation = Math.min(Math.max(this.elevation + down, -Math.PI / 2), Math.PI / 2);
    if (!this.waits) { this.waits = true; requestAnimationFrame(() => { this.waits = false; this.draw(); }); }
  }

  // `values` (count) in the unit of the `label`, null without any; `lumps`: x, y, extents along both [mm].
  show(grid, { values, low, high, label, lumps = [] }) {
    const known = grid.z.map((z, i) => i).filter((i) => grid.z[i] !== null), points = known.map((i) => place(grid, i));
    if (!points.length) return;
    const ends = [0, 1, 2].map((k) => [Math.min(...points.map((p) => p[k])), Math.max(...points.map((p) => p[k]))]);
    this.middle = ends.map(([from, to]) => (from + to) / 2);
    this.radius = Math.hypot(...ends.map(([from, to]) => (to - from) / 2)) || 1;
    Object.assign(this, { grid, low, high, label, cells: cellsOf(grid, values, low, high) });
    this.outlines = lumps.map((lump) => outline(grid, lump));
    const scale = `${label} from ${text(low)} to ${text(high)}`;
    this.canvas.setAttribute("aria-label", `Map on the surface, ${scale}, ${lumps.length} lumps outlined. The arrow keys turn it, Home turns it back.`);
    this.draw();
  }

  project([x, y, z]) { // right, up and towards the viewer
    const [c, s, ce, se] = [Math.cos(this.azimuth), Math.sin(this.azimuth), Math.cos(this.elevation), Math.sin(this.elevation)];
    const away = -s * x + c * y;
    return [c * x + s * y, z * ce + away * se, z * se - away * ce];
  }

  onCanvas(point) {
    const [right, up] = this.project(point.map((v, k) => v - this.middle[k])), scale = 0.49 * (HIGH - FOOT) / this.radius;
    return [WIDE / 2 + scale * right, (HIGH - FOOT) / 2 - scale * up];
  }

  draw() {
    const g = this.canvas.getContext("2d"), corners = new Map();
    const at = (i) => { if (!corners.has(i)) corners.set(i, this.onCanvas(place(this.grid, i))); return corners.get(i); };
    g.clearRect(0, 0, WIDE, HIGH);
    g.lineJoin = "round";
    const sorted = this.cells.map((cell) => ({ ...cell, near: this.project(cell.middle)[2], towards: this.project(cell.normal)[2] }));
    for (const cell of sorted.sort((a, b) => a.near - b.near)) {
      g.fillStyle = g.strokeStyle = cell.towards > 0 ? cell.fill : INSIDE;
      path(g, cell.corners.map(at));
      g.closePath(); g.fill(); g.stroke();
    }
    for (const [width, colour_] of [[9, "#fff"], [5, LUMP]]) {
      g.lineWidth = width; g.strokeStyle = colour_;
      for (const points of this.outlines) for (let i = 1; i < points.length; i++) {
        if (points[i] && points[i - 1] && this.project(points[i].normal)[2] > 0) { path(g, [points[i - 1], points[i]].map((p) => this.onCanvas(p.at))); g.stroke(); }
      }
    }
    g.lineWidth = 1;
    this.legend(g);
  }

  legend(g) {
    const [left, top, wide, high] = [40, HIGH - 70, 520, 22];
    for (let i = 0; i < wide; i++) { g.fillStyle = colour(i / (wide - 1)); g.fillRect(left + i, top, 1.5, high); }
    g.font = "24px system-ui, sans-serif"; g.fillStyle = INK; g.textAlign = "left";
    g.fillText(text(this.low), left, top + 50);
    g.textAlign = "center"; g.fillText(this.label, left + wide / 2, top + 50);
    g.textAlign = "right"; g.fillText(text(this.high), left + wide, top + 50);
    const from = [WIDE - 110, HIGH - 90];
    g.strokeStyle = INK; g.lineWidth = 2.5; g.textAlign = "center";
    "xyz".split("").forEach((name, k) => {
      const [right, up] = this.project([0, 1, 2].map((i) => (i === k ? 1 : 0)));
      path(g, [from, [from[0] + 50 * right, from[1] - 50 * up]]); g.stroke();
      g.fillText(name, from[0] + 72 * right, from[1] - 72 * up + 8);
    });
    g.lineWidth = 1;
  }
}

const text = (value) => String(Number(value.toPrecision(3)));

function path(g, points) {
  g.beginPath();
  points.forEach(([x, y], i) => (i ? g.lineTo(x, y) : g.moveTo(x, y)));
}

function axisAt([from, to, count], i) { return count > 1 ? from + (to - from) * i / (count - 1) : from; }

function place(grid, i) { return [axisAt(grid.x, i % grid.x[2]), axisAt(grid.y, Math.floor(i / grid.x[2])), grid.z[i]]; }

function cellsOf(grid, values, low, high) { // whose four corners are known; their value is the mean of those that are
  const columns = grid.x[2], cells = [];
  for (let i = 0; i < grid.z.length - columns; i++) {
    const corners = [i, i + 1, i + columns + 1, i + columns];
    if ((i + 1) % columns === 0 || corners.some((k) => grid.z[k] === null)) continue;
    const [a, b, c, d] = corners.map((k) => place(grid, k)), some = corners.map((k) => values[k]).filter((v) => v !== null && v === v);
    const normal = unit(cross(minus(c, a), minus(d, b))), light = 0.72 + 0.28 * Math.max(normal[2], 0);
    const fill = some.length ? colour((some.reduce((sum, v) => sum + v) / some.length - low) / (high - low || 1)) : `rgb(${GREY.map((v) => Math.round(v * light)).join(",")})`;
    cells.push({ corners, normal, fill, middle: a.map((v, k) => (v + b[k] + c[k] + d[k]) / 4) });
  }
  return cells;
}

function outline(grid, [x, y, wide, high]) { // an ellipse as seen from above, laid on the skin; null where that is unknown
  return Array.from({ length: 49 }, (_, i) => {
    const turn = i * Math.PI / 24;
    return onSkin(grid, x + wide / 2 * Math.cos(turn), y + high / 2 * Math.sin(turn));
  });
}

function onSkin(grid, x, y) {
  const [u, v] = [[x, grid.x], [y, grid.y]].map(([at, [from, to, count]]) => (at - from) / (to - from) * (count - 1));
  const i = Math.floor(u), j = Math.floor(v), f = u - i, h = v - j, columns = grid.x[2], k = j * columns + i;
  if (!(i >= 0 && j >= 0 && i < columns - 1 && j < grid.y[2] - 1)) return null;
  const z = [k, k + 1, k + columns, k + columns + 1].map((n) => grid.z[n]);
  if (z.some((value) => value === null)) return null;
  const [dx, dy] = [(grid.x[1] - grid.x[0]) / (columns - 1), (grid.y[1] - grid.y[0]) / (grid.y[2] - 1)];
  const height = (z[0] * (1 - f) + z[1] * f) * (1 - h) + (z[2] * (1 - f) + z[3] * f) * h;
  return { at: [x, y, height], normal: [-(z[1] - z[0] + z[3] - z[2]) / (2 * dx), -(z[2] - z[0] + z[3] - z[1]) / (2 * dy), 1] };
}

const minus = (a, b) => a.map((v, k) => v - b[k]);
const cross = ([a, b, c], [d, e, f]) => [b * f - c * e, c * d - a * f, a * e - b * d];
const unit = (v) => { const size = Math.hypot(...v) || 1; return v.map((n) => n / size); };

// The mean of rows [place x, place y, height along the normal, value] (SI) at the node of the grid next to their foot.
export function meansOnSkin(grid, rows, count) {
  const sum = new Float64Array(grid.z.length), number = new Uint32Array(sum.length), [columns, lines] = [grid.x[2], grid.y[2]];
  const next = (at, [from, to, n]) => Math.round((at - from) / (to - from) * (n - 1));
  for (let i = 0; i < count; i++) {
    const [x, y, height, value] = rows(i);
    if (value !== value) continue;
    const foot = onSkin(grid, 1e3 * x, 1e3 * y); // the tip's end is aside of the place that it touches
    if (!foot) continue;
    const aside = 1e3 * height / Math.hypot(...foot.normal), u = next(1e3 * x - aside * foot.normal[0], grid.x), v = next(1e3 * y - aside * foot.normal[1], grid.y);
    if (u >= 0 && v >= 0 && u < columns && v < lines) { sum[v * columns + u] += value; number[v * columns + u]++; }
  }
  return Array.from(sum, (s, i) => (number[i] ? s / number[i] : null));
}
