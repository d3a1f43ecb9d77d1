// The page: takes what comes, and draws what can be seen.
import { Chart, chosen, style } from "./charts.js";
import { drawMap, showOnSkin } from "./map.js";
import { Cards, element, seconds, showDevices, showFlags } from "./panels.js";
import { unpack } from "./numbers.js";
import { Record } from "./record.js";
import { SkinView } from "./skin.js";

const $ = (id) => document.getElementById(id);
const FAST = 40, NUMBERS = 250, SLOW = 500, MAP = 1000, RETRY = 1000; // [ms]
const PHASES = { standstill: "standstill: tare and noise are taken", motion: "moving", tripped: "stopped by the guard", over: "the motion is over" };

let record = null, cards = null, view = null, fast = [], slow = [], socket = null, over = false, asked = false;
let shownAt = null, playing = null; // time that is shown of a recorded run; wall time and record time when playing began
let stamp = 0, fresh = false, delay = null;
window.palpate = { latency: [], arrival: [], asked: null, tripped: null, draws: 0 };

function connect() {
  socket = new WebSocket(new URL("data", location.href.replace(/^http/, "ws")));
  socket.binaryType = "arraybuffer";
  socket.onmessage = ({ data }) => take(unpack(data));
  socket.onclose = () => {
    if (over) return;
    say("no connection", "the program has ended, or has no time; this is what was shown last", true);
    setTimeout(connect, RETRY);
  };
}

function take({ header, time, columns }) {
  if (header.kind === "run") begin(header);
  else if (header.kind === "rows") { record.append(time, columns); fresh = true; stamp = header.stamp ?? 0; if (stamp) keep("arrival", [Date.now() - stamp / 1e6]); soon(); }
  else if (header.kind === "over") { over = true; $("stop").disabled = true; }
  else if (header.kind !== "later") {
    if (header.kind === "guard" && header.phase === "tripped") window.palpate.tripped ??= performance.now();
    record.take(header);
  }
}

function keep(name, values) { // the latest of what is measured here, for benchmarks/live_page.py
  const all = window.palpate[name];
  all.push(...values);
  if (all.length > 4000) all.splice(0, all.length - 4000);
}

function begin(run) {
  record = new Record(run);
  over = false;
  document.title = `${run.name} – palpate`;
  $("name").textContent = run.name;
  $("stop-box").hidden = run.recorded;
  $("player").hidden = !run.recorded;
  $("skin-panel").hidden = !run.skin;
  view ??= new SkinView($("skin"));
  $("what-u").textContent = "± u is the standard uncertainty: scatter, settling, timing, mass, tare and declared sources together, as far as they are known by now. What only the whole record shows, such as a lack of fit, joins it in the result.";
  const styles = run.tracks.map((_, i) => style(i));
  cards = new Cards($("tracks"), run, styles);
  $("charts").replaceChildren();
  ({ fast, slow } = makeCharts(run, styles));
  const select = (id, names) => $(id).replaceChildren(...names.map((name) => element("option", name)));
  select("map-track", run.tracks.map((track) => track.name));
  select("map-parameter", [...new Set(run.tracks.flatMap((track) => track.parameters.map((p) => p.name)))]);
}

function makeCharts(run, styles) {
  const parent = $("charts"), tracks = run.tracks.map((track, i) => ({ ...track, ...styles[i], n: track.parameters.length }));
  const at = (column, factor = 1) => (row) => record.columns[column][row] * factor;
  const line = (track, value, more = {}) => ({ label: track.name, colour: track.colour, dash: track.dash, value, ...more });
  const force = new Chart(parent, { title: "force, N", least: 0.05, series: [
    { label: "measured", colour: "#9aa3ab", dash: [], value: at(0) },
    ...tracks.map((track) => line(track, at(track.begin + 2 * track.n + 1)))] });
  const depth = new Chart(parent, { title: "depth, mm", least: 0.1, series: tracks.map((track) =>
    line(track, (row) => 1e3 * (record.columns[track.begin + 2 * track.n][row] - record.columns[1][row]))) });
  const slow = [];
  for (const name of new Set(tracks.flatMap((track) => track.parameters.map((p) => p.name)))) {
    const own = tracks.filter((track) => track.parameters.some((p) => p.name === name));
    const unit = own[0].parameters.find((p) => p.name === name).unit;
    slow.push(new Chart(parent, { title: `${name}, ${unit} (band ± u)`, robust: true, series: own.map((track) => {
      const k = track.parameters.findIndex((p) => p.name === name), { factor } = track.parameters[k];
      const value = at(track.begin + k, factor), u = at(track.begin + track.n + k, factor);
      return line(track, value, { low: (row) => value(row) - u(row), high: (row) => value(row) + u(row) });
    }) }));
  }
  slow.push(new Chart(parent, { title: "innovation over its std (±2 dashed)", lines: [-2, 2], series:
    tracks.map((track) => line(track, at(track.begin + 2 * track.n + 3))) }));
  slow.push(new Chart(parent, { title: "NIS, mean over 1 s (1 is right)", lines: [1], least: 0.5, robust: true, series:
    tracks.map((track) => line(track, overASecond(track.begin + 2 * track.n + 2))) }));
  return { fast: [force, depth], slow };
}

function overASecond(column) { // a mean that moves on with the rows that are asked for, in their order
  let from = 0, to = 0, sum = 0, count = 0;
  return (row) => {
    const values = record.columns[column], time = record.time;
    if (row < to || from > record.count) { from = to = Math.max(row - 200, 0); sum = count = 0; }
    for (; to <= row; to++) if (values[to] === values[to]) { sum += values[to]; count++; }
    for (; time[from] < time[row] - 1; from++) if (values[from] === values[from]) { sum -= values[from]; count--; }
    return count && values[row] === values[row] ? sum / count : NaN;
  };
}

function say(text, why = "", bad = false) {
  $("state").textContent = text;
  $("state").className = bad ? "state bad" : "state";
  $("why").textContent = why;
}

function showState(state, t) {
  const { run } = record, duration = run.duration, guard = state.guard;
  const call = guard?.calls_for_stop && !run.recorded;
  document.body.classList.toggle("emergency", call);
  if (call) say("PRESS THE EMERGENCY STOP", guard.reason, true);
  else if (over && !run.recorded) say(guard?.phase === "tripped" ? "stopped by the guard" : "the run has ended", `${guard?.reason ?? ""} palpate replay watch ${run.folder} shows it again`, guard?.phase === "tripped");
  else if (run.recorded) say("recorded run", guard?.reason ?? "");
  else if (!(record.end > 0) && !asked) say("waiting", "for the first reading: robot and sensors are connecting");
  else if (guard) say(PHASES[guard.phase], guard.reason ?? "", guard.phase === "tripped");
  else if (socket?.readyState === 1) say(asked ? "stop was asked for" : "running");
  $("stop").textContent = guard ? "Stop and retract" : "Stop";
  if (guard?.phase === "tripped") $("stop").disabled = true;
  $("time").textContent = seconds(t);
  const whole = run.recorded ? record.end : duration;
  $("left").textContent = whole ? seconds(Math.max(whole - t, 0)) : "–";
  $("progress").hidden = !whole;
  if (whole) $("progress").value = Math.min(t / whole, 1);
}

function showNumbers(rows) {
  const force = record.last(0, rows);
  $("force").textContent = Number.isFinite(force) ? `${force.toFixed(2)} N` : "–";
  const height = record.last(1, rows);
  const surfaces = record.run.tracks.map((track) => record.last(track.begin + 2 * track.parameters.length, rows)).filter(Number.isFinite);
  $("depth-name").textContent = surfaces.length ? "depth" : "height of the tip";
  const shown = surfaces.length ? surfaces[surfaces.length - 1] - height : height;
  $("depth").textContent = Number.isFinite(shown) ? `${(1e3 * shown).toFixed(2)} mm` : "–";
}

function now() {
  if (!record.run.recorded) return record.end;
  if (playing) {
    shownAt = playing.from + (performance.now() - playing.at) / 1e3 * Number($("speed").value);
    if (shownAt >= record.end) { shownAt = record.end; pause(); }
    $("slider").value = shownAt;
  }
  $("slider").max = record.end;
  if (shownAt === null) $("slider").value = record.end;
  return shownAt ?? record.end;
}

function pause() { playing = null; $("play").textContent = "Play"; }

function play() {
  if (playing) { pause(); return; }
  const from = shownAt === null || shownAt >= record.end ? 0 : shownAt;
  playing = { from, at: performance.now() };
  $("play").textContent = "Pause";
  soon();
}

// A frame is asked for when there is something to draw: by rows that come, not faster than FAST, and now and then by
// the clock, for what changes without rows. So the first rows after a pause are drawn at once, and a page at rest rests.
let drawn = { fast: 0, numbers: 0, slow: 0, map: 0 }, before = null, asked_for = false, known = 0, even = false; // rows that were drawn

function soon() {
  if (asked_for) return;
  asked_for = true;
  const wait = drawn.fast + FAST - performance.now();
  if (wait > 4) setTimeout(() => requestAnimationFrame(frame), wait); else requestAnimationFrame(frame);
}

function frame(at) {
  asked_for = false;
  if (!record) return;
  if (playing) soon();
  const t = now();
  if (!fresh && t === before && at - drawn.numbers < NUMBERS) return;
  const rows = record.rowsUntil(t), window_ = Number($("window").value);
  const from = window_ ? Math.max(t - window_, 0) : record.count ? record.time[0] : 0;
  const some = chosen(record, from, t);
  const [force, ...others] = fast; // the force as soon as can be, the others in every second frame of many
  force.draw(record, some, from, t);
  if ((even = !even) || !fresh) for (const chart of others) chart.draw(record, some, from, t);
  drawn.fast = at;
  if (fresh && stamp && !record.run.recorded && known < record.count) arrived(known);
  known = record.count;
  fresh = false; before = t;
  if (at - drawn.numbers < NUMBERS) return;
  drawn.numbers = at;
  const state = record.until(t);
  showState(state, t);
  cards.show(record, rows, state);
  showNumbers(rows);
  window.palpate.draws++;
  if (at - drawn.slow < SLOW) return;
  drawn.slow = at;
  for (const chart of slow) chart.draw(record, some, from, t);
  if (at - drawn.map < MAP) return;
  drawn.map = at;
  showFlags($("flags"), state);
  showDevices($("devices"), state.health, delay);
  showMap(rows);
}

// From the sensor's reading to the drawn curve, of every row, where both clocks are that of this machine: the stamp is
// that of the latest row, and what is drawn is on the canvas when the frame's work is done.
function arrived(from) {
  const end = record.end, at = stamp / 1e6, rows = Array.from(record.time.subarray(from, record.count));
  setTimeout(() => {
    const late = Date.now() - at;
    if (Math.abs(late) > 1e4) return; // another machine's clock
    keep("latency", rows.map((time) => late + 1e3 * (end - time)));
    delay = late;
  });
}

function showMap(rows) {
  const track = record.run.tracks[$("map-track").selectedIndex], name = $("map-parameter").value;
  const k = track ? track.parameters.findIndex((p) => p.name === name) : -1;
  if (k < 0) { $("map").hidden = true; $("map-note").textContent = `${track?.name ?? "no track"} has no ${name}`; return; }
  drawMap(record, rows, track.begin + k, track.parameters[k], $("map"), $("map-note"));
  if (record.run.skin) showOnSkin(view, record, rows, track.begin + k, track.parameters[k]);
}

function stop() {
  if (!record || record.run.recorded || over || socket?.readyState !== 1 || $("stop").disabled) return;
  window.palpate.asked = performance.now();
  socket.send("stop");
  asked = true;
}

$("stop").addEventListener("click", stop);
document.addEventListener("keydown", (event) => { if (event.key === "Escape") stop(); });
$("play").addEventListener("click", play);
$("slider").addEventListener("input", () => { shownAt = Number($("slider").value); if (playing) playing = { from: shownAt, at: performance.now() }; soon(); });
$("speed").addEventListener("change", () => { if (playing) playing = { from: shownAt, at: performance.now() }; });
for (const id of ["map-track", "map-parameter"]) $(id).addEventListener("change", () => { drawn.map = 0; });
setInterval(soon, NUMBERS);
connect();
