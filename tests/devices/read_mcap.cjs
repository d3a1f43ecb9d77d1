// Counts and sums of every topic of an MCAP file, by the readers of npm. NODE_PATH says where they are.
const fs = require("fs");
const { McapStreamReader } = require("@mcap/core");
const { parse } = require("@foxglove/rosmsg");
const { MessageReader } = require("@foxglove/rosmsg2-serialization");
const { decompress } = require("fzstd");

function sum(value) {
  if (typeof value === "number") return value;
  if (typeof value === "bigint") return Number(value);
  if (value === null || typeof value !== "object") return 0;
  return Object.values(value).reduce((total, inner) => total + sum(inner), 0);
}

const reader = new McapStreamReader({
  validateCrcs: true,
  decompressHandlers: { zstd: (data) => decompress(data) },
});
reader.append(fs.readFileSync(process.argv[2]));
const schemas = {}, channels = {}, found = {};
for (let record; (record = reader.nextRecord()); ) {
  if (record.type === "Schema") schemas[record.id] = new TextDecoder().decode(record.data);
  if (record.type === "Channel") {
    channels[record.id] = [record.topic, new MessageReader(parse(schemas[record.schemaId], { ros2: true }))];
  }
  if (record.type === "Message") {
    const [topic, decoder] = channels[record.channelId];
    const message = decoder.readMessage(record.data);
    delete message.header;
    found[topic] = found[topic] ?? [0, 0];
    found[topic][0] += 1;
    found[topic][1] += sum(message);
  }
}
console.log(JSON.stringify(found));
