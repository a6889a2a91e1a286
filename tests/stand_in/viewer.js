// Attaches to `farreach bridge foxglove` with the client and the decoder that Lichtblick, and
// Foxglove before it, are built on, and prints what came as JSON.
//
//     NODE_PATH=.../node_modules node viewer.js ws://ADDRESS:PORT SAMPLES
//
// Subscribes to every channel, decodes each message by the schema that was advertised, and ends
// once so many samples are there.

const { FoxgloveClient } = require("@foxglove/ws-protocol");
const { parse } = require("@foxglove/rosmsg");
const { MessageReader } = require("@foxglove/rosmsg2-serialization");
const { WebSocket } = require("ws");

const LIMIT_MS = 60_000;
const [address, count] = [process.argv[2], Number(process.argv[3])];
const fail = (why) => {
  console.error(why);
  process.exit(1);
};
setTimeout(() => fail("not enough samples"), LIMIT_MS);

const client = new FoxgloveClient({
  ws: new WebSocket(address, [FoxgloveClient.SUPPORTED_SUBPROTOCOL]),
});
const readers = new Map();
const result = { server: undefined, channels: 0, decoded: {}, statuses: [], samples: [] };

client.on("error", (error) => fail(String(error)));
client.on("serverInfo", (info) => (result.server = info.name));
client.on("status", (status) => result.statuses.push(status.message));
client.on("advertise", (channels) => {
  for (const channel of channels) {
    if (channel.encoding !== "cdr" || channel.schemaEncoding !== "ros2msg") {
      fail(`${channel.topic}: ${channel.encoding}, ${channel.schemaEncoding}`);
    }
    const reader = new MessageReader(parse(channel.schema, { ros2: true }));
    readers.set(client.subscribe(channel.id), { topic: channel.topic, reader });
    result.channels += 1;
  }
});
client.on("message", ({ subscriptionId, timestamp, data }) => {
  const { topic, reader } = readers.get(subscriptionId);
  const message = reader.readMessage(data);
  result.decoded[topic] = (result.decoded[topic] ?? 0) + 1;
  if (topic !== "sample") {
    return;
  }
  const { sequence, tick, time_ns: time, master_position: position } = message;
  const offset = timestamp - time;
  result.samples.push([Number(sequence), Number(tick), position[0], String(offset)]);
  if (result.samples.length === count) {
    // To end before a pipe has taken it all would cut it off.
    process.stdout.write(JSON.stringify(result), () => process.exit(0));
  }
});
