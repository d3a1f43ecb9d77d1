// The form of the open facts: a field for each, most effective first; the program checks all answers at once.
const $ = (id) => document.getElementById(id);

export function openFacts(m) {
  $("facts-note").textContent = m.fields.length ? `Most effective first. What is stated is kept in ${m.file}.` : `Every fact is stated: ${m.file}, curves.csv or the pipeline.`;
  $("fact-fields").replaceChildren(...m.fields.map(field));
  $("facts-mistake").textContent = "";
  $("facts-state").hidden = !m.fields.length;
  if (!$("facts").open) $("facts").showModal();
}

function field({ key, question, example, effect }) {
  const line = document.createElement("p"), label = document.createElement("label"), input = document.createElement("input");
  const about = document.createElement("span"), mistake = document.createElement("span");
  Object.assign(input, { id: `fact-${key}`, placeholder: example, spellcheck: false, autocomplete: "off", maxLength: 300 });
  Object.assign(label, { htmlFor: input.id, textContent: question });
  Object.assign(about, { id: `${input.id}-effect`, className: "note", textContent: `empty: not known; ${effect}` });
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
    const given = Array.from($("fact-fields").querySelectorAll("input"), (input) => [input.dataset.key, input.value.trim()]).filter(([, text]) => text);
    if (!given.length) $("facts-mistake").textContent = "nothing is stated";
    else send({ do: "state", answers: Object.fromEntries(given) });
  });
}
