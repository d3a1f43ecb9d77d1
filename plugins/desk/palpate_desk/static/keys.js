// Keys: one table, from which the help is made, too. None has an effect in a text field.
export const KEYS = [
  [["ArrowUp", "k"], "the curve above", "up"], [["ArrowDown", "j"], "the curve below", "down"],
  [["PageUp"], "ten above", "page-up"], [["PageDown"], "ten below", "page-down"], [["Home"], "the first", "first"], [["End"], "the last", "last"],
  [["n"], "the next that is flagged and unmarked", "next"], [["g"], "mark as good, and go on", "good"], [["x"], "reject, and go on", "bad"],
  [[" "], "clear the mark", "clear"], [["r"], "fit this curve", "refit"], [["R"], "fit all that are stale", "refit-all"],
  [["m"], "model", "model"], [["t"], "tip", "tip"], [["s"], "segment", "segment"], [["c"], "compare with another model", "compare"],
  [["b"], "budget", "budget"], [["z"], "drop the range", "unrange"], [["/"], "filter; Esc leaves the field", "filter"],
  [["1"], "curve", "screen-curve"], [["2"], "groups", "screen-groups"], [["3"], "map", "screen-map"], [["4"], "export", "screen-export"],
  [["f"], "facts of the rig that are open", "facts"], [["u"], "undo", "undo"], [["?"], "this help", "help"],
];

export function listen(does) {
  const by = new Map(KEYS.flatMap(([keys, , what]) => keys.map((key) => [key, what])));
  document.addEventListener("keydown", (event) => {
    const field = event.target.closest("input, select, textarea, dialog");
    if (field) { if (event.key === "Escape" && !field.closest("dialog")) field.blur(); return; }
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if ((event.key === " " || event.key === "Enter") && event.target.closest("button, summary, a")) return;
    const what = by.get(event.key);
    if (what) { event.preventDefault(); does(what); }
  });
}

export function help(list) {
  const names = { ArrowUp: "↑", ArrowDown: "↓", " ": "space" };
  list.replaceChildren(...KEYS.flatMap(([keys, text]) => {
    const [dt, dd] = [document.createElement("dt"), document.createElement("dd")];
    dt.textContent = keys.map((key) => names[key] ?? key).join(" "); dd.textContent = text;
    return [dt, dd];
  }));
}
