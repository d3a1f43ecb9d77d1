import { CurveView } from "./curve.js";
import { listenFacts, openFacts, takeMistakes } from "./facts.js";
import { help, listen } from "./keys.js";
import { measured, unpack } from "./numbers.js";
import { drawGroups, drawHistogram, drawSites } from "./points.js";
import { Table } from "./table.js";

const $ = (id) => document.getElementById(id);
const PALE = 100, TYPING = 150; // [ms]
let folder = null, socket = null, number = 0, waiting = null, over = false, range = null, screen = "curve", refitting = null, comparing = null, peeking = null;
const reasons = [];
window.palpate = { asked: 0, drawn: 0, errors: [] };

const view = new CurveView({ depth: $("plot-depth"), time: $("plot-time"), residual: $("plot-residual") }, $("busy"), chooseRange);
const peek = new CurveView({ depth: $("peek-depth") }, $("peek-busy"), () => {}); // on the map
const table = new Table($("head"), $("table"), look);

function connect() {
  socket = new WebSocket(new URL("data", location.href.replace(/^http/, "ws")));
  socket.binaryType = "arraybuffer";
  socket.onmessage = ({ data }) => take(unpack(data));
  socket.onopen = () => { over = false; hush(); };
  socket.onclose = () => {
    if (!over) warn("no connection: the program has ended, or has no time; this is what was shown last");
    setTimeout(connect, 2000);
  };
}

function send(message) {
  if (socket?.readyState !== WebSocket.OPEN) { warn("no connection: nothing was done"); return false; }
  socket.send(JSON.stringify(message));
  return true;
}

const TAKES = {
  folder: takeFolder,
  rows: (m) => { table.replace(m.rows); takeState(m); count(); redraw(m.rows.some((row) => row.curve === table.current?.curve)); },
  state: (m) => takeState(m.state),
  curve: (m, whole) => takeCurve(m, whole),
  filter: (m) => { if (m.words === $("filter").value) { hush(); table.filter(m.words.trim() ? m.names : null); if (!table.current) table.pick(0); count(); redraw(false); } },
  done: (m) => { hush(); told(m.command); },
  note: (m) => warn(m.text),
  error: (m) => { window.palpate.errors.push(m.text); refitting = null; clearTimeout(waiting); shownView().settle(); warn(m.text); },
  facts: openFacts,
  mistakes: takeMistakes,
  groups: takeGroups,
  compare: (m, whole) => takeCompare(m, whole),
  export: (m) => { $("export-note").textContent = m.text; told(m.command); },
  over: () => { over = true; warn("palpate desk has ended; this is what was shown last, and everything is kept in the folder"); },
};

function take(whole) { TAKES[whole.header.kind]?.(whole.header, whole); }

function takeFolder(m) {
  const first = folder === null;
  folder = m;
  $("name").textContent = m.name.split("/").pop();
  $("name").title = m.name;
  document.title = `${m.name}: palpate desk`;
  const values = Object.keys(m.units).slice(0, 2);
  table.columns(values, m.units, m.residual_unit);
  table.fill(m.rows);
  for (const [id, value] of [["tip", m.tip], ["segment", m.segment]]) if (document.activeElement !== $(id)) $(id).value = value;
  options($("model"), m.models, m.model);
  options($("by"), m.columns.length ? m.columns : ["no column"], $("by").value || m.group_by);
  for (const id of ["parameter", "map-parameter"]) options($(id), Object.keys(m.units), $(id).value);
  for (const element of document.querySelectorAll("footer button, footer input, footer select, #exports button")) if (element.id !== "help-button" && element.id !== "copy") element.disabled = m.read_only;
  takeState(m.state);
  count();
  if (first) table.pick(0);
  else if (table.current) look(table.current);
  if ($("filter").value.trim()) send({ do: "filter", words: $("filter").value });
  redraw(false);
}

function takeState(state) {
  $("refits").hidden = !state.running;
  $("progress").max = Math.max(state.count, 1); $("progress").value = state.done;
  $("progress-text").textContent = `${state.done} of ${state.count}`;
  $("undo").disabled = !state.undo || folder?.read_only;
  $("undo").title = state.undo ? `takes back: ${state.undo}` : "nothing to undo";
}

function options(select, names, value) {
  select.replaceChildren(...names.map((name) => new Option(name, name)));
  if (names.includes(value)) select.value = value;
}

function count() {
  const curves = new Set(table.rows.map((row) => row.curve)).size, shown = new Set(table.shown.map((row) => row.curve)).size;
  const has = (holds) => table.rows.filter(holds).length;
  $("counts").textContent = `${shown} of ${curves} curves · ${has((r) => r.state !== "current")} to fit · ${has((r) => r.mark === "bad")} rejected · ${Object.keys(folder.units).slice(0, 2).map(partition).join("; ")}`;
}

// How many rows have which word for a value.
function partition(name) {
  const counts = {};
  for (const row of table.rows) {
    const word = row.state !== "current" ? "to fit" : row.error ? "not read" : row.verdicts[name] || "without";
    counts[word] = (counts[word] ?? 0) + 1;
  }
  return `${name.replaceAll("_", " ")}: ${Object.entries(counts).map(([word, count]) => `${count} ${word}`).join(", ")}`;
}

function look(row) {
  if (!row) return;
  number += 1;
  comparing = null;
  window.palpate.asked = number;
  clearTimeout(waiting);
  waiting = setTimeout(() => shownView().fade(), PALE);
  words(row);
  if (screen !== "curve" && screen !== "map") return;
  send({ do: "curve", curve: row.curve, number });
}

function shownView() { return screen === "map" ? peek : view; }

function words(row, messages = new Map()) {
  $("curve-name").textContent = table.short(row.curve);
  $("curve-name").title = row.curve;
  const shown = row.state === "current";
  $("curve-values").textContent = shown ? Object.entries(row.values).map(([name, [, , text]]) => `${name} ${text} ${folder.units[name]} ${row.verdicts[name]}`).join(" · ") : "";
  const about = shown ? [] : [row.state === "stale" ? "stale: made with other settings; r fits it" : "not fitted yet; r fits it"];
  if (Object.keys(row.facts).length) about.push(`curves.csv: ${Object.entries(row.facts).map(([name, text]) => `${name} ${text}`).join(", ")}`);
  if (row.mark === "bad") about.push(`rejected: ${row.reason}`);
  if (row.mark === "good") about.push("marked as good");
  if (row.error) about.push(row.error);
  for (const text of folder.own[row.curve] ?? []) about.push(`own: ${text}`);
  $("curve-note").textContent = about.join(" · ");
  $("flags").replaceChildren(row.state === "current" ? flags(row, messages) : "");
  $("compare").replaceChildren();
  const key = `estimator.${folder.fit}.segment=`, own = (folder.own[row.curve] ?? []).find((text) => text.startsWith(key));
  if (!range && document.activeElement !== $("segment")) $("segment").value = own ? own.slice(key.length).replaceAll('"', "") : folder.segment;
}

function flags(row, messages) {
  const list = document.createElement("table");
  for (const code of row.flags) {
    const line = list.insertRow(), known = folder.meanings[code] ?? { severity: "", meaning: "", remedy: "" };
    for (const text of [code, known.severity, messages.get(code) ?? known.meaning, known.remedy]) line.insertCell().textContent = text;
    line.cells[1].className = known.severity;
  }
  return list;
}

function takeCurve(m, whole) {
  const current = table.current;
  if (!current || m.curve !== current.curve || (m.number && m.number !== number)) return; // it was overtaken
  clearTimeout(waiting);
  refitting = null;
  shownView().show(whole);
  $("peek-name").textContent = `${table.short(m.curve)}: force over depth`;
  words(current, new Map((m.flags ?? []).map((flag) => [flag.code, flag.message])));
  if (m.raw) $("curve-note").textContent += m.error && !current.error ? ` · ${m.error}` : " · force and height as read";
  budget(m.budget ?? []);
  window.palpate.drawn += 1;
  window.palpate.latest = m.curve;
}

function budget(rows) {
  const list = document.createElement("table"), names = Object.keys(folder.units);
  const head = list.insertRow();
  for (const text of ["source", ...names.map((name) => `${name} %`)]) head.insertCell().textContent = text;
  for (const row of rows) {
    const line = list.insertRow();
    line.insertCell().textContent = row.source;
    for (const name of names) line.insertCell().textContent = row.percent[name] === undefined || row.percent[name] === null ? "?" : row.percent[name].toPrecision(3);
  }
  $("budget-rows").replaceChildren(list);
}

function told(command) { $("command").textContent = command; $("command-line").hidden = false; }
function warn(text) { $("banner").textContent = text; $("banner").hidden = false; }
function hush() { $("banner").hidden = true; }

function redraw(again) {
  if (screen === "groups") groups(); else if (screen === "map") sites();
  else if (again && table.current) { words(table.current); if (refitting !== table.current.curve) look(table.current); }
}

function stale() {
  const old = table.shown.filter((row) => row.state === "stale").length;
  return old ? `; ${old} are stale: made with other settings (R fits them)` : "";
}

function groups() {
  const by = folder.columns.length ? $("by").value : "", name = $("parameter").value;
  const drawn = drawGroups($("groups-plot"), table.shown, by, name, folder.units[name], showCurve);
  drawHistogram($("histogram"), table.shown, name, folder.units[name]);
  $("groups-note").textContent = drawn ? `${drawn} curves; hollow: rejected, in no number; the box holds the middle half${stale()}` : "no curve has a value";
  if (!folder.columns.length) $("groups-note").textContent += " · columns to group by come from curves.csv, or --groups TABLE.csv";
}

function takeGroups(m) {
  const list = document.createElement("table"), head = list.insertRow(), [unit, factor] = [folder.units[m.found.parameter], m.factor];
  for (const text of ["group", "curves", `mean ${unit}`, `scatter ${unit}`]) head.insertCell().textContent = text;
  const number = (v) => (v === null ? "-" : (v * factor).toPrecision(4));
  for (const [name, found] of Object.entries(m.found.groups)) {
    const line = list.insertRow();
    const u = found.combined_of_mean === null ? null : factor * found.combined_of_mean;
    for (const text of [name, found.count, measured(factor * found.mean, u), number(found.std)]) line.insertCell().textContent = text;
  }
  const [most, apart] = [20, m.found.tests.filter((t) => t.p !== null).sort((a, b) => a.p - b.p)];
  const lines = apart.slice(0, most).map((t) => `${t.difference_is}: ${number(t.difference)} ${unit}, p = ${t.p_corrected.toPrecision(2)}`);
  if (apart.length > most) lines.push(`and ${apart.length - most} pairs of a larger p`);
  const tests = [m.found.sentence, ...lines].filter((text) => text).map((text) => {
    const line = document.createElement("p");
    line.textContent = text;
    return line;
  });
  $("groups-table").replaceChildren(list, ...tests);
  told(m.command);
}

function takeCompare(m, whole) {
  if (comparing !== m.curve) return; // another curve or other settings since
  comparing = null;
  const line = document.createElement("p"), list = document.createElement("table"), head = list.insertRow();
  line.textContent = m.found.sentence;
  for (const text of ["model", "BIC behind", "weight %", "held out N", "lack of fit"]) head.insertCell().textContent = text;
  for (const one of m.found.standings) {
    const row = list.insertRow(), digits = (v) => (v === null ? "-" : v.toPrecision(3));
    for (const text of [one.model, digits(one.behind), digits(100 * one.weight), digits(one.held_out), one.misfits ? "yes" : "no"]) row.insertCell().textContent = text;
  }
  $("compare").replaceChildren(line, list);
  const first = view.answer;
  if (m.error) line.textContent += ` ${m.model}: ${m.error}`;
  else if (first?.header.curve === m.curve && !first.header.raw && first.time.length === whole.time.length) view.show(first, { name: m.model, model: whole.columns[2] });
  told(m.command);
}

function sites() {
  const name = $("map-parameter").value, drawn = drawSites($("sites"), table.shown, name, folder.units[name], showCurve, choosePlaces, peekCurve);
  $("map-note").textContent = drawn ? `${drawn} curves with a place; rejected ones are hollow; the curve under the cursor is drawn next to them, a click opens it; a dragged rectangle is a filter${stale()}` : "no curve has a place: give x_m and y_m in curves.csv, or lateral_x and lateral_y in [alignment]";
}

// Filter words for a rectangle [mm], in place of those of the one before.
function choosePlaces(xs, ys) {
  const others = $("filter").value.replace(/(^|\s)[xy][<>]=?[-+.\de]+(?=\s|$)/g, "").trim();
  const words = [["x", xs], ["y", ys]].flatMap(([name, [low, high]]) => {
    const digits = Math.min(Math.max(2 - Math.floor(Math.log10(high - low)), 0), 12); // of which the last is a hundredth of the rectangle
    return [`${name}>=${+low.toFixed(digits)}`, `${name}<=${+high.toFixed(digits)}`];
  });
  $("filter").value = [others, ...words].join(" ").trim();
  send({ do: "filter", words: $("filter").value });
}

// The curve under the cursor, once it rests there.
function peekCurve(name) { clearTimeout(peeking); peeking = setTimeout(() => { if (screen === "map") table.pickCurve(name); }, PALE); }

function showCurve(name) { show("curve"); table.pickCurve(name); }

function show(what) {
  screen = what;
  for (const name of ["curve", "groups", "map", "export"]) $(`screen-${name}`).hidden = name !== what;
  for (const button of $("screens").children) button.setAttribute("aria-pressed", button.dataset.screen === what);
  if (what === "curve") { if (table.current) look(table.current); } else redraw(false);
}

function mark(what, reason = "") {
  const row = table.current;
  if (!row || !send({ do: "mark", curve: row.curve, mark: what, reason })) return;
  if (what !== "none" && table.picked < table.shown.length - 1) table.pick(table.picked + 1);
}

function reject() {
  if (!table.current || folder.read_only) return;
  $("reject-name").textContent = table.short(table.current.curve);
  $("reasons").replaceChildren(...reasons.map((text) => new Option(text)));
  $("reason").value = reasons[0] ?? "";
  $("reject").returnValue = "no";
  $("reject").showModal();
  $("reason").select();
}

$("reject").addEventListener("close", () => {
  const why = $("reason").value.trim();
  if ($("reject").returnValue !== "yes" || !why) return;
  if (reasons.includes(why)) reasons.splice(reasons.indexOf(why), 1);
  reasons.unshift(why); reasons.length = Math.min(reasons.length, 5);
  mark("bad", why);
  $("table").focus();
});

const quoted = (text) => (/^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\"'\"'")}'`);
const one = () => quoted(`curve=${table.current.curve}`);
const shownWords = () => $("filter").value.trim();

function chooseRange(text) { range = text; $("range").hidden = false; $("range-text").textContent = text; $("segment").value = text; }
function dropRange() { range = null; $("range").hidden = true; $("segment").value = folder.segment; for (const plot of view.plots) plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false); }

function apply(where) {
  const changes = [];
  if ($("segment").value.trim() !== folder.segment || where !== null || range) changes.push({ do: "set", assignment: `estimator.${folder.fit}.segment=${JSON.stringify($("segment").value.trim())}`, where });
  if ($("tip").value.trim() !== folder.tip) {
    if (where !== null) { warn("a tip is one for all curves of a folder: press all"); return; }
    changes.push({ do: "tip", value: $("tip").value.trim() });
  }
  if ($("model").value !== folder.model) {
    if (where !== null) { warn("a model is one for all curves of a folder: press all"); return; }
    changes.push({ do: "model", value: $("model").value });
  }
  if (!changes.length) warn("nothing is changed");
  changes.forEach(send);
  if (range) { range = null; $("range").hidden = true; }
}

function refit() { if (table.current && send({ do: "refit", curve: table.current.curve })) { refitting = table.current.curve; comparing = null; view.fade(); told(`palpate fit ${folder.name} --where "curve=${table.current.curve}"`); } }
function refitAll() { if (send({ do: "refit-all" })) told(`palpate fit ${folder.name}`); }
function compare() {
  if (!table.current) return;
  const other = $("model").value !== folder.model ? $("model").value : folder.model === "hunt-crossley" ? "dimensionality-reduction" : "hunt-crossley";
  if (!send({ do: "compare", curve: table.current.curve, model: other })) return;
  comparing = table.current.curve;
  $("compare").textContent = "models are fitted ...";
}
const focus = (id) => () => { $(id).focus(); $(id).select?.(); };

const DOES = {
  up: () => table.pick(table.picked - 1), down: () => table.pick(table.picked + 1), "page-up": () => table.pick(table.picked - 10),
  "page-down": () => table.pick(table.picked + 10), first: () => table.pick(0), last: () => table.pick(table.shown.length - 1),
  next: () => table.next((row) => row.mark === "none" && Object.values(row.verdicts).some((word) => ["doubtful", "invalid"].includes(word))) || warn("no curve is flagged and unmarked"),
  good: () => mark("good"), bad: reject, clear: () => mark("none"), refit, "refit-all": refitAll,
  model: focus("model"), tip: focus("tip"), segment: focus("segment"), filter: focus("filter"), compare,
  budget: () => { $("budget").open = !$("budget").open; }, unrange: dropRange, undo: () => send({ do: "undo" }), facts: () => !folder.read_only && send({ do: "facts", curve: table.current?.curve ?? "" }), help: () => $("help").showModal(),
  ...Object.fromEntries(["curve", "groups", "map", "export"].map((name) => [`screen-${name}`, () => show(name)])),
};
listen((what) => folder && DOES[what]());
help($("keys"));
listenFacts(send);

let typing = null;
$("filter").addEventListener("input", () => { clearTimeout(typing); typing = setTimeout(() => send({ do: "filter", words: $("filter").value }), TYPING); });
$("filter").addEventListener("keydown", (event) => { if (event.key === "Enter") { $("filter").blur(); $("table").focus(); } });
for (const button of $("screens").children) button.addEventListener("click", () => show(button.dataset.screen));
const CLICKS = {
  cancel: () => send({ do: "cancel" }), "apply-this": () => table.current && apply(one()), "apply-shown": () => (shownWords() ? apply(shownWords()) : warn("write a filter first, or press all")),
  "apply-all": () => apply(null), refit, "refit-all": refitAll, undo: () => send({ do: "undo" }), "open-facts": () => DOES.facts(), "help-button": () => $("help").showModal(),
  copy: () => navigator.clipboard?.writeText($("command").textContent), "range-this": () => apply(one()), "range-all": () => apply(null), "range-none": dropRange,
  test: () => send({ do: "groups", by: $("by").value, parameter: $("parameter").value }),
};
for (const [id, does] of Object.entries(CLICKS)) $(id).addEventListener("click", does);
for (const id of ["by", "parameter", "map-parameter"]) $(id).addEventListener("change", () => { $("groups-table").replaceChildren(); redraw(false); });

const EXPORTS = [
  ["report", "a page on all curves, by group: report.html", () => ({ by: folder.columns.length ? $("by").value : "" })],
  ["groups", "a figure of the groups: groups.svg", () => ({ by: folder.columns.length ? $("by").value : "", parameter: $("parameter").value })],
  ["map", "a map with its table: maps/", () => ({ parameter: $("map-parameter").value })],
  ["figure", "the figures and the whole result of this curve: figures/", () => ({ curve: table.current?.curve ?? "" })],
  ["history", "what was done, as a script: history.sh", () => ({})],
];
$("exports").append(...EXPORTS.map(([what, text, more]) => {
  const line = document.createElement("li"), button = document.createElement("button");
  button.type = "button"; button.id = `export-${what}`; button.textContent = what;
  button.addEventListener("click", () => { if (send({ do: "export", what, ...more() })) $("export-note").textContent = `${what} is made ...`; });
  line.append(button, ` ${text}`);
  return line;
}), Object.assign(document.createElement("li"), { textContent: "The table itself is fits.csv in the folder, with every number in SI; curves.csv and review.json are next to it." }));

connect();
