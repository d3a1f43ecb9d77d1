// Numbers and tables. Every text is set as text: names come from users, logs and plugins.
import { measured } from "./numbers.js";

export function element(tag, text = "", kind = "") {
  const made = document.createElement(tag);
  made.textContent = text;
  if (kind) made.className = kind;
  return made;
}

export const seconds = (t) => t >= 120 ? `${Math.floor(t / 60)} min ${Math.floor(t % 60)} s` : `${t.toFixed(1)} s`;

const SEVERITIES = ["good", "note", "doubtful", "invalid"];
const WORDS = { good: "good", note: "good", doubtful: "doubtful", invalid: "invalid" };

function worst(state, track) {
  let found = 0;
  for (const entry of state.flags.values())
    if (entry.until === null && (entry.track === null || entry.track === track))
      found = Math.max(found, SEVERITIES.indexOf(entry.flag.severity ?? "doubtful"));
  return SEVERITIES[found];
}

export class Cards {
  constructor(parent, run, styles) {
    parent.replaceChildren();
    this.cards = run.tracks.map((track, i) => {
      const card = element("div", "", "card"), head = element("h2"), verdict = element("span"), table = element("table");
      card.style.borderLeftColor = styles[i].colour;
      head.append(element("span", track.name), verdict);
      card.append(head, table);
      parent.append(card);
      const rows = track.parameters.map((parameter) => this.row(table, parameter.name, parameter.unit));
      return { track, verdict, table, rows, derived: new Map() };
    });
  }

  row(table, name, unit) {
    const row = element("tr"), value = element("td");
    row.append(element("td", name), value, element("td", unit));
    table.append(row);
    return value;
  }

  show(record, rows, state) {
    for (const card of this.cards) {
      const { track } = card, found = state.found[track.name], n = track.parameters.length;
      const verdict = found?.verdict ?? worst(state, track.name), words = WORDS[verdict] ?? verdict;
      card.verdict.textContent = !found ? "± of the estimator alone" : `${words} ${found.final ? "(result)" : "so far"}`;
      card.verdict.className = !found || verdict === "note" || !(verdict in WORDS) ? "note-flag" : verdict;
      track.parameters.forEach((parameter, k) => {
        const final = found?.final ? found.parameters[parameter.name] : null;
        const value = final ? final[0] ?? NaN : record.last(track.begin + k, rows);
        const u = final ? final[1] : record.last(track.begin + n + k, rows);
        const number = measured(value * parameter.factor, u === null ? null : u * parameter.factor);
        card.rows[k].textContent = final?.[4] ? `${number} ${final[4]}` : number;
      });
      for (const [name, [value, combined, unit, factor, word]] of Object.entries(found?.derived ?? {})) {
        if (!card.derived.has(name)) card.derived.set(name, this.row(card.table, `${name} (derived)`, unit));
        card.derived.get(name).textContent = word || measured((value ?? NaN) * factor, combined === null ? null : combined * factor);
      }
    }
  }
}

export function showFlags(parent, state) {
  const entries = [...state.flags.values()].sort((a, b) => (a.until !== null) - (b.until !== null)
    || SEVERITIES.indexOf(b.flag.severity) - SEVERITIES.indexOf(a.flag.severity) || a.since - b.since);
  if (!entries.length) { parent.replaceChildren(element("p", "No flags.", "good")); return; }
  const table = element("table"), head = element("tr");
  head.append(...["severity", "flag", "of", "from", "what it says"].map((text) => element("th", text)));
  table.append(head);
  for (const { track, flag, since, until } of entries) {
    const row = element("tr", "", until === null ? "" : "gone"), text = element("td", flag.message);
    if (flag.meaning) text.append(element("div", `${flag.meaning} ${flag.remedy}`, "meaning"));
    const severity = flag.severity ?? "doubtful";
    row.append(
      element("td", severity, severity === "note" ? "note-flag" : severity), element("td", flag.code),
      element("td", track ?? "every track"), element("td", `${since.toFixed(1)} s${until === null ? "" : ` to ${until.toFixed(1)} s`}`), text);
    table.append(row);
  }
  parent.replaceChildren(table);
}

const plain = (value) => value === null || value === undefined ? "–"
  : typeof value === "number" ? (Number.isInteger(value) ? `${value}` : `${+value.toPrecision(4)}`)
  : Array.isArray(value) ? value.map(plain).join(", ") : `${value}`;

function table(title, heads, rows) {
  const box = element("div"), made = element("table"), head = element("tr");
  head.append(...heads.map((text) => element("th", text)));
  made.append(head);
  for (const cells of rows) {
    const row = element("tr");
    row.append(...cells.map((cell) => element("td", cell)));
    made.append(row);
  }
  box.append(element("h2", title), made);
  return box;
}

// Numbers of a device by their names; those within others as "lateness p99".
function flat(value, name = "") {
  if (value === null || typeof value !== "object" || Array.isArray(value)) return [[name.trim(), plain(value)]];
  return Object.entries(value).flatMap(([key, inner]) => flat(inner, `${name} ${key.replaceAll("_", " ")}`));
}

export function showDevices(parent, health, delay) {
  if (!health) { parent.replaceChildren(element("p", "No reports yet.", "note")); return; }
  const streams = Object.entries(health.streams ?? {}), made = [];
  const heads = ["samples", "invalid", "duplicates", "backwards", "gaps", "saturated"];
  made.push(table("Streams", ["stream", "rate Hz", ...heads],
    streams.map(([name, s]) => [name, plain(s.rate), ...heads.map((key) => plain(s[key]))])));
  const whole = [["estimates behind the readings", `${plain(health.behind)} s`]];
  if (health.tare) whole.push(["tare", `${plain(health.tare.offset)} N`], ["noise of the force at standstill", `${plain(health.tare.noise)} N`]);
  if (delay !== null) whole.push(["this page behind the sensor", `${Math.round(delay)} ms`]);
  made.push(table("Run", ["", ""], whole));
  for (const [name, device] of Object.entries(health.devices ?? {})) made.push(table(name, ["", ""], flat(device)));
  parent.replaceChildren(...made);
}
