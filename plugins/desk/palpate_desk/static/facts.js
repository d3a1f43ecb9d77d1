// The form of the open facts: a field for each, most effective first; the program checks all answers at once.
const $ = (id) => document.getElementById(id);

export function openFacts(m) {
  $("facts-note").textContent = m.fields.length ? `Most effective first. What is stated is kept in ${m.file}.` : m.settled;
  $("fact-fields").replaceChildren(...m.fields.map(field), ...m.stated.map((fact) => field({ ...fact, effect: `of ${m.curve} alone` })));
  $("facts-mistake").textContent = "";
  $("facts-state").hidden = !m.fields.length && !m.stated.length;
  if (!$("facts").open) $("facts").showModal();
}

// With a value: a fact of one curve, which is changed for that curve alone.
function field({ key, question, example, effect, value, curve }) {
  const line = document.createElement("p"), label = document.createElement("label"), input = document.createElement("input");
  const about = document.createElement("span"), mistake = document.createElement("span");
  Object.assign(input, { id: `fact-${key}`, placeholder: example, spellcheck: false, autocomplete: "off", maxLength: 300 });
  Object.assign(label, { htmlFor: input.id, textContent: question });
  Object.assign(about, { id: `${input.id}-effect`, className: "note", textContent: value === undefined ? `empty: not known; ${effect}` : `${value} ${effect}` });
  if (value !== undefined) Object.assign(input, { value, id: `${input.id}-of-curve` }), Object.assign(input.dataset, { curve, value }), label.htmlFor = input.id;
  Object.assign(mistake, { id: `${input.id}-mistake`, className: "invalid" });
  input.dataset.key = key;
  input.setAttribute("aria-describedby", `${about.id} ${mistake.id}`);
  line.append(label, input, about, mistake);
  return line;
}

export function takeMistakes({ mistakes }) {
  for (const input of $("fact-fields").querySelectorAll("input")) {
    const text = mistakes[input.dataset.key] ?? "";
    $(`${input.id}-mistake`).textContent = text;
    input.setAttribute("aria-invalid", text !== "");
  }
  $("facts-mistake").textContent = mistakes[""] ?? "";
  if (!Object.keys(mistakes).length) $("facts").close();
  else $("fact-fields").querySelector("[aria-invalid=true]")?.focus();
}

export function listenFacts(send) {
  $("facts-close").addEventListener("click", () => $("facts").close());
  $("facts-form").addEventListener("submit", (event) => {
    event.preventDefault();
    const inputs = Array.from($("fact-fields").querySelectorAll("input")).filter((input) => input.value.trim());
    const given = inputs.filter((input) => !input.dataset.curve).map((input) => [input.dataset.key, input.value.trim()]);
    const changed = inputs.filter((input) => input.dataset.curve && input.value.trim() !== input.dataset.value);
    for (const input of changed) send({ do: "set", assignment: `rig.${input.dataset.key}=${JSON.stringify(input.value.trim())}`, where: input.dataset.curve });
    if (given.length) send({ do: "state", answers: Object.fromEntries(given) });
    else if (changed.length) $("facts").close();
    else $("facts-mistake").textContent = "nothing is stated";
  });
}
