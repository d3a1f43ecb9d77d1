// Numbers: in messages, as palpate_kit.page.datagrams packs them, and as texts.
const decoder = new TextDecoder();

export function unpack(data) {
  if (typeof data === "string") return { header: JSON.parse(data) };
  const length = new DataView(data).getUint32(0, true);
  const header = JSON.parse(decoder.decode(new Uint8Array(data, 4, length)));
  const begin = 4 + length, rows = header.rows;
  const all = new Float32Array(data, begin + 8 * rows);
  const columns = [];
  for (let at = 0; rows && at + rows <= all.length; at += rows) columns.push(all.subarray(at, at + rows));
  return { header, time: new Float64Array(data, begin, rows), columns };
}

// A value and its uncertainty, to two digits of the uncertainty.
export function measured(value, u) {
  if (!Number.isFinite(value)) return "–";
  if (u === null || Number.isNaN(u)) return `${+value.toPrecision(4)} ± ?`;
  if (!(Number.isFinite(u) && u > 0)) return `${+value.toPrecision(4)}`;
  const digits = Math.min(Math.max(0, 1 - Math.floor(Math.log10(u))), 12);
  return `${value.toFixed(digits)} ± ${u.toFixed(digits)}`;
}
