// SPDX-License-Identifier: Apache-2.0
//
// Writes a run log as a robot with ROS 2 would have recorded it, with foreign code alone: messages
// are serialized by @foxglove/rosmsg2-serialization, MCAP files written by @mcap/core, and SQLite
// files by Python (write_db3.py). Usage: write_bag.mjs '{"input": RUN.mcap, "output": FOLDER, ...}':
//   storage      "mcap" or "sqlite3"
//   distro       "humble", "iron" or "jazzy": form of the metadata and of the SQLite schema
//   detections   "detection3d", "fiducial" or "apriltag"
//   odometry     "odometry", "twist" or "twist_big_endian"
//   compression  "none", "zstd_chunk", "lz4_chunk", "zstd_message" or "zstd_file"
//   split        number of files
//   metadata     false leaves metadata.yaml out
//   sd_m         standard deviation that a detection3d states, 0 for none
// The camera looks forward and to the left, in an optical frame, behind a chain of three transforms.
// SHIFTMAP_NODE_MODULES names the node_modules folder that holds the packages.
import { createRequire } from "node:module";
import { execFileSync } from "node:child_process";
import { mkdirSync, readFileSync, writeFileSync } from "node:fs";
import path from "node:path";

const require = createRequire(path.join(process.env.SHIFTMAP_NODE_MODULES, "package.json"));
const { McapStreamReader, McapWriter } = require("@mcap/core");
const { CdrWriter, EncapsulationKind } = require("@foxglove/cdr");
const { parse, stringify } = require("@foxglove/rosmsg");
const { MessageWriter } = require("@foxglove/rosmsg2-serialization");
const { ros2jazzy } = require("@foxglove/rosmsg-msgs-common");
const lz4 = require("lz4js");
const protobuf = require("protobufjs");
const descriptor = require("protobufjs/ext/descriptor");
const { ZstdCodec } = require("zstd-codec");

const zstd = await new Promise((done) => ZstdCodec.run((codec) => done(new codec.Simple())));
const spec = JSON.parse(process.argv[2]);

// The types of others than ROS itself, in the words of their own .msg files' fields.
const texts = {
  "vision_msgs/Detection3DArray": `# A list of detections
std_msgs/Header header
Detection3D[] detections
================================================================================
MSG: vision_msgs/Detection3D
std_msgs/Header header
ObjectHypothesisWithPose[] results   # one per class
BoundingBox3D bbox
string id
================================================================================
MSG: vision_msgs/ObjectHypothesisWithPose
ObjectHypothesis hypothesis
geometry_msgs/PoseWithCovariance pose
================================================================================
MSG: vision_msgs/ObjectHypothesis
string class_id
float64 score
================================================================================
MSG: vision_msgs/BoundingBox3D
geometry_msgs/Pose center
geometry_msgs/Vector3 size`,
  "fiducial_msgs/FiducialTransformArray": `std_msgs/Header header
int32 image_seq
FiducialTransform[] transforms
===
MSG: fiducial_msgs/FiducialTransform
int32 fiducial_id
geometry_msgs/Transform transform
float64 image_error
float64 object_error
float64 fiducial_area`,
  "apriltag_msgs/AprilTagDetectionArray": `std_msgs/Header header
AprilTagDetection[] detections
===
MSG: apriltag_msgs/AprilTagDetection
string family
int32 id
int32 hamming
float32 goodness
float32 decision_margin
Point centre
Point[4] corners
float64[9] homography
===
MSG: apriltag_msgs/Point
float64 x
float64 y`,
};

const needed = [
  ["std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id"],
  ["geometry_msgs/PoseWithCovariance", "geometry_msgs/Pose pose\nfloat64[36] covariance"],
  ["geometry_msgs/Pose", "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation"],
  ["geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z"],
  ["geometry_msgs/Quaternion", "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1"],
  ["geometry_msgs/Transform", "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation"],
  ["geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z"],
  ["builtin_interfaces/Time", "int32 sec\nuint32 nanosec"],
];

// All types that a type of ROS is made of, itself first.
function withParts(name) {
  const all = [];
  const add = (type) => {
    if (all.some((other) => other.name === type)) return;
    all.push(ros2jazzy[type]);
    for (const field of ros2jazzy[type].definitions) if (field.isComplex) add(field.type);
  };
  add(name);
  return all;
}

function textOf(type) {
  if (!texts[type]) return stringify(withParts(type));
  return [texts[type], ...needed.map(([name, text]) => `===\nMSG: ${name}\n${text}`)].join("\n");
}

const writers = new Map();
function serialize(type, message) {
  if (!writers.has(type)) writers.set(type, new MessageWriter(parse(textOf(type), { ros2: true })));
  return Buffer.from(writers.get(type).writeMessage(message));
}

function twistBigEndian(message) {
  const writer = new CdrWriter({ kind: EncapsulationKind.CDR_BE });
  writer.int32(message.header.stamp.sec).uint32(message.header.stamp.nanosec);
  writer.string(message.header.frame_id);
  for (const part of ["linear", "angular"]) {
    for (const axis of ["x", "y", "z"]) writer.float64(message.twist[part][axis]);
  }
  return Buffer.from(writer.data);
}

// The items of a run log, read with the schemas that it carries.
function readRunLog(file) {
  const decompressHandlers = { zstd: (bytes) => zstd.decompress(bytes) };
  const reader = new McapStreamReader({ decompressHandlers });
  reader.append(new Uint8Array(readFileSync(file)));
  const schemas = new Map();
  const channels = new Map();
  const items = [];
  for (let record; (record = reader.nextRecord()); ) {
    if (record.type === "Schema") {
      const set = descriptor.FileDescriptorSet.decode(record.data);
      schemas.set(record.id, protobuf.Root.fromDescriptor(set).lookupType(record.name));
    }
    if (record.type === "Channel") channels.set(record.id, record);
    if (record.type !== "Message") continue;
    const channel = channels.get(record.channelId);
    const type = schemas.get(channel.schemaId);
    const options = { defaults: true, oneofs: true };
    items.push({ topic: channel.topic, ...type.toObject(type.decode(record.data), options) });
  }
  return items;
}

const ns = (value) => BigInt(value.toString());
const stampOf = (stamp_ns) => ({
  sec: Number(ns(stamp_ns) / 1000000000n),
  nanosec: Number(ns(stamp_ns) % 1000000000n),
});

// base_link -> mast (moved), mast -> camera (turned), camera -> optical (axes).
const yaw = 0.2;
const mast = { x: 0.3, y: 0.1, z: 0.5 };
const identity = { x: 0, y: 0, z: 0, w: 1 };
const turn = { x: 0, y: 0, z: Math.sin(yaw / 2), w: Math.cos(yaw / 2) };
const axes = { x: -0.5, y: 0.5, z: -0.5, w: 0.5 };

// A landmark 1.2 m above the floor as the camera sees it: x to the right, y down, z forward.
function inCamera(observation) {
  const polar = observation.range_bearing;
  const x = polar ? polar.range_m * Math.cos(polar.bearing_rad) : observation.position_in_vehicle.x_m;
  const y = polar ? polar.range_m * Math.sin(polar.bearing_rad) : observation.position_in_vehicle.y_m;
  const [dx, dy, dz] = [x - mast.x, y - mast.y, 1.2 - mast.z];
  const forward = Math.cos(yaw) * dx + Math.sin(yaw) * dy;
  const left = -Math.sin(yaw) * dx + Math.cos(yaw) * dy;
  return { x: -left, y: -dz, z: forward };
}

const idOf = (signature) => Number(signature.replace(/\D/g, ""));
const zero = { x: 0, y: 0, z: 0 };
const transform = (frame_id, child_frame_id, stamp, translation, rotation) => ({
  header: { stamp, frame_id },
  child_frame_id,
  transform: { translation, rotation },
});

function detections(item) {
  const header = { stamp: stampOf(item.stamp_ns), frame_id: "camera_optical" };
  const seen = item.observation.map((o) => ({ signature: o.signature, p: inCamera(o) }));
  if (spec.detections === "fiducial") {
    const transforms = seen.map(({ signature, p }) => ({
      fiducial_id: idOf(signature),
      transform: { translation: p, rotation: identity },
    }));
    return [["/fiducials", "fiducial_msgs/FiducialTransformArray", { header, image_seq: 7, transforms }]];
  }
  if (spec.detections === "apriltag") {
    const tags = seen.map(({ signature }) => ({ family: "tag36h11", id: idOf(signature) }));
    const transforms = seen.map(({ signature, p }) =>
      transform("camera_optical", `tag36h11:${idOf(signature)}`, header.stamp, p, identity),
    );
    return [
      ["/apriltag/detections", "apriltag_msgs/AprilTagDetectionArray", { header, detections: tags }],
      ["/tf", "tf2_msgs/TFMessage", { transforms }],
    ];
  }
  const covariance = new Array(36).fill(0);
  for (let i = 0; i < 3; ++i) covariance[7 * i] = spec.sd_m ** 2;
  const list = seen.map(({ signature, p }, i) => ({
    header,
    results: [
      { hypothesis: { class_id: "unlikely", score: 0.1 }, pose: { pose: { position: zero }, covariance } },
      { hypothesis: { class_id: signature, score: 0.9 }, pose: { pose: { position: p }, covariance } },
    ],
    bbox: { center: { position: p } },
    id: `track ${i}`,
  }));
  return [["/detections", "vision_msgs/Detection3DArray", { header, detections: list }]];
}

function odometry(item) {
  const header = { stamp: stampOf(item.stamp_ns), frame_id: "odom" };
  const twist = {
    linear: { x: item.v_mps, y: 0, z: 0 },
    angular: { x: 0, y: 0, z: item.omega_radps },
  };
  if (spec.odometry === "odometry") {
    return ["/odom", "nav_msgs/Odometry", { header, child_frame_id: "base_link", twist: { twist } }];
  }
  return ["/twist", "geometry_msgs/TwistStamped", { header: { ...header, frame_id: "base_link" }, twist }];
}

// Messages as they reach the recorder: odometry after 5 ms, detections after 90 ms.
function record(items) {
  const messages = [];
  const add = (time, [topic, type, message]) => {
    const big = spec.odometry === "twist_big_endian" && type === "geometry_msgs/TwistStamped";
    messages.push({ time, topic, type, data: big ? twistBigEndian(message) : serialize(type, message) });
  };
  const begin = ns(items.find((item) => item.topic === "/odometry").stamp_ns);
  const stamp = stampOf(begin);
  add(begin, [
    "/tf_static",
    "tf2_msgs/TFMessage",
    {
      transforms: [
        transform("base_link", "mast", stamp, mast, identity),
        transform("mast", "camera", stamp, zero, turn),
        transform("camera", "camera_optical", stamp, zero, axes),
        transform("base_link", "lidar", stamp, { x: 9, y: 9, z: 9 }, identity),
      ],
    },
  ]);
  for (const item of items) {
    if (item.topic === "/odometry") add(ns(item.stamp_ns) + 5000000n, odometry(item));
    if (item.topic !== "/landmarks") continue;
    for (const message of detections(item)) add(ns(item.stamp_ns) + 90000000n, message);
  }
  messages.sort((a, b) => (a.time < b.time ? -1 : a.time > b.time ? 1 : 0));
  return messages;
}

const longType = (type) => type.replace("/", "/msg/");

async function writeMcap(file, messages) {
  const parts = [];
  let position = 0n;
  const writable = {
    position: () => position,
    write: async (part) => {
      parts.push(Buffer.from(part));
      position += BigInt(part.length);
    },
  };
  const compressChunk = {
    zstd_chunk: (chunk) => ({ compression: "zstd", compressedData: zstd.compress(chunk) }),
    lz4_chunk: (chunk) => ({ compression: "lz4", compressedData: new Uint8Array(lz4.compress(chunk)) }),
  }[spec.compression];
  const writer = new McapWriter({ writable, compressChunk, chunkSize: 50000 });
  await writer.start({ profile: "ros2", library: "reference" });
  const channels = new Map();
  for (const { topic, type } of messages) {
    if (channels.has(topic)) continue;
    const data = Buffer.from(textOf(type));
    const name = longType(type);
    const schemaId = await writer.registerSchema({ name, encoding: "ros2msg", data });
    const metadata = new Map([["offered_qos_profiles", ""]]);
    channels.set(
      topic,
      await writer.registerChannel({ topic, schemaId, messageEncoding: "cdr", metadata }),
    );
  }
  let sequence = 0;
  for (const { time, topic, data } of messages) {
    const channelId = channels.get(topic);
    const times = { logTime: time, publishTime: time };
    await writer.addMessage({ channelId, sequence: sequence++, ...times, data });
  }
  await writer.end();
  writeFileSync(file, Buffer.concat(parts));
}

function writeSqlite(file, messages) {
  const topics = new Map(messages.map(({ topic, type }) => [topic, type]));
  const lines = [...topics].map(([topic, type]) =>
    ["topic", topic, longType(type), Buffer.from(textOf(type)).toString("hex")].join("\t"),
  );
  for (const { time, topic, data } of messages) {
    lines.push(["message", topic, String(time), data.toString("hex")].join("\t"));
  }
  const script = path.join(path.dirname(process.argv[1]), "write_db3.py");
  execFileSync("python3", [script, file, spec.distro], { input: lines.join("\n") });
}

function metadata(files, messages) {
  const storage = spec.storage;
  const mode = { zstd_message: "MESSAGE", zstd_file: "FILE" }[spec.compression] ?? "";
  const topics = new Map(messages.map(({ topic, type }) => [topic, type]));
  return `rosbag2_bagfile_information:
  version: ${{ humble: 5, iron: 6, jazzy: 9 }[spec.distro]}
  storage_identifier: ${storage}
  duration:
    nanoseconds: ${messages.at(-1).time - messages[0].time}
  starting_time:
    nanoseconds_since_epoch: ${messages[0].time}
  message_count: ${messages.length}
  topics_with_message_count:
${[...topics]
  .map(
    ([topic, type]) => `    - topic_metadata:
        name: ${topic}
        type: ${longType(type)}
        serialization_format: cdr
        offered_qos_profiles: ${spec.distro === "jazzy" ? "\n          []" : '""'}
      message_count: ${messages.filter((message) => message.topic === topic).length}`,
  )
  .join("\n")}
  compression_format: ${mode === "" ? '""' : "zstd"}
  compression_mode: "${mode}"
  relative_file_paths:
${files.map((file) => `    - ${file}`).join("\n")}
`;
}

mkdirSync(spec.output);
const messages = record(readRunLog(spec.input));
if (spec.compression === "zstd_message") {
  for (const message of messages) message.data = Buffer.from(zstd.compress(message.data));
}
const files = [];
const name = path.basename(spec.output);
const length = Math.ceil(messages.length / spec.split);
for (let i = 0; i < spec.split; ++i) {
  const part = messages.slice(i * length, (i + 1) * length);
  const file = `${name}_${i}.${spec.storage === "mcap" ? "mcap" : "db3"}`;
  const written = path.join(spec.output, file);
  if (spec.storage === "mcap") await writeMcap(written, part);
  else writeSqlite(written, part);
  if (spec.compression === "zstd_file") {
    writeFileSync(`${written}.zstd`, zstd.compress(readFileSync(written)));
    execFileSync("rm", [written]);
  }
  files.push(spec.compression === "zstd_file" ? `${file}.zstd` : file);
}
if (spec.metadata) writeFileSync(path.join(spec.output, "metadata.yaml"), metadata(files, messages));
