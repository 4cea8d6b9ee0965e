// SPDX-License-Identifier: Apache-2.0
//
// The reference's side of the test against MCAP's reference implementation (mcap_reference_test.sh):
//   print IN              prints a run log as mcap_reference_tool does, read with the schemas that
//                         the file itself carries, once front to back and once through its index
//   summary IN            prints what one of our files says about itself, as JSON
//   rewrite IN OUT zstd|none|unchunked   writes the same messages with the reference's writer
// SHIFTMAP_NODE_MODULES names the node_modules folder that holds the packages of package.json.
import { createRequire } from "node:module";
import { readFileSync, writeFileSync } from "node:fs";
import { isDeepStrictEqual } from "node:util";
import path from "node:path";

const require = createRequire(path.join(process.env.SHIFTMAP_NODE_MODULES, "package.json"));
const { McapStreamReader, McapIndexedReader, McapWriter } = require("@mcap/core");
const protobuf = require("protobufjs");
const descriptor = require("protobufjs/ext/descriptor");
const { ZstdCodec } = require("zstd-codec");

const zstd = await new Promise((done) => ZstdCodec.run((codec) => done(new codec.Simple())));
const decompressHandlers = { zstd: (bytes) => zstd.decompress(bytes) };

function readStream(bytes) {
  const reader = new McapStreamReader({ decompressHandlers, validateCrcs: true });
  reader.append(bytes);
  const log = { schemas: new Map(), channels: new Map(), messages: [], records: {} };
  for (let record; (record = reader.nextRecord()); ) {
    log.records[record.type] = (log.records[record.type] ?? 0) + 1;
    if (record.type === "Schema") log.schemas.set(record.id, record);
    if (record.type === "Channel") log.channels.set(record.id, record);
    if (record.type === "Message") log.messages.push(record);
  }
  if (!reader.done()) throw new Error("the file ends early");
  return log;
}

async function openIndexed(bytes) {
  const readable = {
    size: async () => BigInt(bytes.length),
    read: async (begin, size) => bytes.slice(Number(begin), Number(begin + size)),
  };
  return await McapIndexedReader.Initialize({ readable, decompressHandlers });
}

async function readIndexed(bytes) {
  const messages = [];
  for await (const message of (await openIndexed(bytes)).readMessages()) messages.push(message);
  return messages;
}

function bits(value) {
  const view = new DataView(new ArrayBuffer(8));
  view.setFloat64(0, value);
  return view.getBigUint64(0).toString(16).padStart(16, "0");
}

function decoders(log) {
  const types = new Map();
  for (const [id, channel] of log.channels) {
    const schema = log.schemas.get(channel.schemaId);
    const root = protobuf.Root.fromDescriptor(descriptor.FileDescriptorSet.decode(schema.data));
    types.set(id, root.lookupType(schema.name));
  }
  return types;
}

function observationText(observation) {
  const polar = observation.range_bearing;
  const cartesian = observation.position_in_vehicle;
  const z = polar
    ? ["polar", bits(polar.range_m), bits(polar.bearing_rad)]
    : ["cartesian", bits(cartesian.x_m), bits(cartesian.y_m)];
  const cov = observation.covariance;
  return [
    `[${observation.signature}]`,
    ...z,
    ...(cov ? [bits(cov.c00), bits(cov.c01), bits(cov.c11)] : []),
  ].join(" ");
}

function messageText(topic, message) {
  if (topic === "/run_info") return `info [${message.vehicle}] [${message.source}]`;
  if (topic === "/odometry") {
    return `${message.stamp_ns} odometry ${bits(message.v_mps)} ${bits(message.omega_radps)}`;
  }
  if (topic === "/lidar") {
    let range_mm = 0;
    const { field_of_view_rad, max_range_m, lidar_x_m, lidar_y_m, lidar_yaw_rad } = message;
    return [
      `${message.stamp_ns} lidar`,
      ...[field_of_view_rad, max_range_m, lidar_x_m, lidar_y_m, lidar_yaw_rad].map(bits),
      ...message.range_step_mm.map((step) => (range_mm += step)),
    ].join(" ");
  }
  return [`${message.stamp_ns} scan`, ...message.observation.map(observationText)].join(" ");
}

async function print(bytes) {
  const log = readStream(bytes);
  if (log.records.ChunkIndex && !isDeepStrictEqual(await readIndexed(bytes), log.messages)) {
    throw new Error("the index gives other messages than the file");
  }
  const types = decoders(log);
  for (const message of log.messages) {
    const decoded = types.get(message.channelId).decode(message.data);
    console.log(messageText(log.channels.get(message.channelId).topic, decoded));
  }
}

async function summary(bytes) {
  const reader = await openIndexed(bytes);
  // Then tools read it front to back; with one, they would miss the message indexes.
  if (reader.chunkIndexes.length > 0) throw new Error("there is a chunk index");
  const channels = [...reader.channelsById.values()];
  console.log(
    JSON.stringify({
      profile: reader.header.profile,
      library: reader.header.library,
      topics: channels.map((channel) => channel.topic).sort(),
      messages: Number(reader.statistics.messageCount),
      messages_by_topic: Object.fromEntries(
        channels.map((channel) => [
          channel.topic,
          Number(reader.statistics.channelMessageCounts.get(channel.id)),
        ]),
      ),
      start_ns: String(reader.statistics.messageStartTime),
      end_ns: String(reader.statistics.messageEndTime),
    }),
  );
}

async function rewrite(bytes, output, kind) {
  const log = readStream(bytes);
  const parts = [];
  let position = 0n;
  const writable = {
    position: () => position,
    write: async (part) => {
      parts.push(Buffer.from(part));
      position += BigInt(part.length);
    },
  };
  const compressChunk =
    kind === "zstd"
      ? (chunk) => ({ compression: "zstd", compressedData: zstd.compress(chunk) })
      : undefined;
  const useChunks = kind !== "unchunked";
  const writer = new McapWriter({ writable, compressChunk, useChunks, chunkSize: 20000 });
  await writer.start({ profile: "", library: "reference" });
  const channelIds = new Map();
  for (const [id, channel] of log.channels) {
    const schemaId = await writer.registerSchema(log.schemas.get(channel.schemaId));
    channelIds.set(id, await writer.registerChannel({ ...channel, schemaId }));
  }
  for (const message of log.messages) {
    await writer.addMessage({ ...message, channelId: channelIds.get(message.channelId) });
  }
  await writer.end();
  writeFileSync(output, Buffer.concat(parts));
}

const [command, input, ...rest] = process.argv.slice(2);
await { print, summary, rewrite }[command](new Uint8Array(readFileSync(input)), ...rest);
