// SPDX-License-Identifier: Apache-2.0
//
// Reads a recording of a shift with MCAP's reference implementation and compares it with the public
// schemas of Foxglove (recording_reference_test.sh):
//   node recording_reference.mjs RECORDING TRAJECTORY.tum RUN.json
// SHIFTMAP_NODE_MODULES names the node_modules folder that holds the packages.
import assert from "node:assert/strict";
import { createRequire } from "node:module";
import { readFileSync } from "node:fs";
import path from "node:path";

const require = createRequire(path.join(process.env.SHIFTMAP_NODE_MODULES, "package.json"));
const { McapStreamReader } = require("@mcap/core");
const { foxgloveEnumSchemas, foxgloveMessageSchemas, generateProto } =
  require("@foxglove/schemas/internal");
const protobuf = require("protobufjs");
const descriptor = require("protobufjs/ext/descriptor");
const { ZstdCodec } = require("zstd-codec");

const zstd = await new Promise((done) => ZstdCodec.run((codec) => done(new codec.Simple())));

// The messages of each topic, and the schemas by name.
function read(file) {
  const reader = new McapStreamReader({
    decompressHandlers: { zstd: (bytes) => zstd.decompress(bytes) },
    validateCrcs: true,
  });
  reader.append(new Uint8Array(readFileSync(file)));
  const schemas = new Map();
  const channels = new Map();
  const types = new Map();
  const topics = {};
  for (let record; (record = reader.nextRecord()); ) {
    if (record.type === "Schema") {
      const set = descriptor.FileDescriptorSet.decode(record.data);
      types.set(record.name, protobuf.Root.fromDescriptor(set).resolveAll());
      schemas.set(record.id, record.name);
    } else if (record.type === "Channel") {
      channels.set(record.id, record);
      topics[record.topic] ??= []; // The summary repeats it.
    } else if (record.type === "Message") {
      const channel = channels.get(record.channelId);
      const name = schemas.get(channel.schemaId);
      const type = types.get(name).lookupType(name);
      const value = type.toObject(type.decode(record.data), { longs: BigInt, defaults: true, enums: String });
      topics[channel.topic].push({ time: record.logTime, value });
    }
  }
  assert(reader.done(), "the file ends early");
  return { types, topics };
}

// The public definitions, all in one tree.
function publicRoot() {
  const root = new protobuf.Root();
  for (const schema of Object.values(foxgloveMessageSchemas)) {
    const enums = Object.values(foxgloveEnumSchemas).filter((e) => e.parentSchemaName === schema.name);
    protobuf.parse(generateProto(schema, enums), root, { keepCase: true });
  }
  for (const name of ["Timestamp", "Duration"]) {
    root.define("google.protobuf").add(new protobuf.Type(name));
  }
  return root.resolveAll();
}

function fieldText(field) {
  const type = field.resolvedType ? field.resolvedType.fullName : field.type;
  return `${field.repeated ? "repeated " : ""}${type} ${field.name} = ${field.id}`;
}

// Every field of ours is one of the public message, and so are the values of the enumerations.
function compareSchemas(types) {
  const root = publicRoot();
  let fields = 0;
  const compare = (ours, theirs) => {
    for (const field of ours.fieldsArray) {
      const expected = theirs.fields[field.name];
      assert(expected, `${ours.fullName}.${field.name} is not public`);
      assert.equal(fieldText(field), fieldText(expected), ours.fullName);
      ++fields;
    }
    for (const nested of ours.nestedArray) {
      const expected = theirs.lookupEnum(nested.name).values;
      assert.deepEqual({ ...nested.values }, { ...expected }, nested.fullName);
    }
  };
  for (const [name, ours] of types) {
    if (!name.startsWith("foxglove.")) continue;
    for (const message of ours.lookup("foxglove").nestedArray) {
      compare(message, root.lookupType(`foxglove.${message.name}`));
    }
  }
  assert(fields > 100, `only ${fields} fields`);
  return fields;
}

const seconds = (timestamp) => Number(timestamp.seconds) + 1e-9 * timestamp.nanos;
const yaw = ({ z, w }) => 2 * Math.atan2(z, w);

// The poses of the recording are those of the trajectory, and no two are closer than the bound.
function comparePoses(topics, trajectory) {
  const truth = new Map();
  for (const line of readFileSync(trajectory, "utf8").split("\n")) {
    const [t, x, y, , , , z, w] = line.split(" ").map(Number);
    if (w !== undefined) truth.set(t.toFixed(3), { x, y, yaw: yaw({ z, w }) });
  }
  const poses = topics["/pose"];
  assert(poses.length > 100);
  for (const [i, { value }] of poses.entries()) {
    const expected = truth.get(seconds(value.timestamp).toFixed(3));
    assert(expected, `no pose at ${seconds(value.timestamp)}`);
    const { position, orientation } = value.pose;
    assert(Math.hypot(position.x - expected.x, position.y - expected.y) < 1e-9);
    assert(Math.abs(Math.sin(yaw(orientation) - expected.yaw)) < 1e-9);
    if (i > 0) assert(poses[i].time - poses[i - 1].time >= 99_999_999n);
    const transform = topics["/tf"][i].value;
    assert.deepEqual(transform.rotation, orientation);
    assert.equal(transform.parent_frame_id, "map");
  }
  return poses.length;
}

// Opacity is probability: of each sphere and ellipse that of its mode in the metadata.
function checkScene(topics) {
  const updates = topics["/map/scene"];
  const [first] = updates;
  const map = topics["/map"][0].value;
  assert.equal(first.value.entities.length, map.group.length);
  for (const { value } of updates) {
    for (const entity of value.entities) {
      const probabilities = entity.metadata.map((pair) => Number(pair.value));
      assert(Math.abs(probabilities.reduce((a, b) => a + b) - 1) < 1e-3);
      entity.spheres.forEach((sphere, i) => {
        assert(Math.abs(sphere.color.a - probabilities[1 + Math.floor(i / 2)]) < 1e-4);
      });
    }
  }
  return updates.length;
}

const [recording, trajectory, run] = process.argv.slice(2);
const { types, topics } = read(recording);
const document = JSON.parse(readFileSync(run, "utf8"));
const fields = compareSchemas(types);
const poses = comparePoses(topics, trajectory);
const updates = checkScene(topics);

const states = topics["/state"].map(({ value }) => value.to);
assert.deepEqual(states, document.state_changes.map((change) => change.to));
const made = topics["/decisions"].filter(({ value }) => !value.withdrawn).length;
assert.equal(made - (topics["/decisions"].length - made), document.decisions.length);
assert.equal(topics["/log"].length, states.length + topics["/decisions"].length);
const innovations = topics["/innovations"].flatMap(({ value }) => value.innovation);
const gated = innovations.filter(({ mode }) => mode !== 0n);
assert(gated.length >= 0.9 * document.nis.count && gated.length <= document.nis.count);
for (const { value } of topics["/hypotheses"]) {
  assert(Math.abs(value.leaf_weight.reduce((a, b) => a + b) - 1) < 1e-6);
}
console.log(`${fields} fields, ${poses} poses and ${updates} updates of the scene agree`);
