// Prints each message of an MCAP file as Foxglove reads it: type, whether bytes were left, content.
const fs = require("fs");
const { McapIndexedReader } = require("@mcap/core");
const { loadDecompressHandlers } = require("@mcap/support");
const { parseRos2idl } = require("@foxglove/ros2idl-parser");
const { parse } = require("@foxglove/rosmsg");
const { MessageReader } = require("@foxglove/rosmsg2-serialization");

const plain = (_, value) =>
  typeof value === "bigint" ? Number(value) : ArrayBuffer.isView(value) ? Array.from(value) : value;

async function main(path) {
  const data = fs.readFileSync(path);
  const readable = {
    size: async () => BigInt(data.length),
    read: async (offset, length) => data.subarray(Number(offset), Number(offset + length)),
  };
  const decompressHandlers = await loadDecompressHandlers();
  const file = await McapIndexedReader.Initialize({ readable, decompressHandlers });
  const readers = new Map();
  for (const [id, schema] of file.schemasById) {
    const text = new TextDecoder().decode(schema.data);
    const types = schema.encoding === "ros2idl" ? parseRos2idl(text) : parse(text, { ros2: true });
    readers.set(id, new MessageReader(types));
  }
  for await (const message of file.readMessages()) {
    const schema = file.schemasById.get(file.channelsById.get(message.channelId).schemaId);
    const reader = readers.get(schema.id);
    const content = reader.readMessage(message.data);
    const rest = reader.lastReadHadTrailingBytes();
    console.log(JSON.stringify({ type: schema.name, rest, content }, plain));
  }
}

main(process.argv[2]).catch((error) => {
  console.error(error);
  process.exit(1);
});
