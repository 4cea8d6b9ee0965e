// SPDX-License-Identifier: Apache-2.0
#include "mapstore/codec/run_log.h"

#include <algorithm>
#include <fstream>
#include <iostream>
#include <utility>

#include "mapstore/codec/input_file.h"
#include "mapstore/codec/run_log_messages.h"
#include "mapstore/codec/utf8.h"
#include "mapstore/core/atomic_file.h"
#include "mapstore/map/sha256.h"
#include "proto/mcap/reader.h"
#include "proto/mcap/writer.h"

namespace shiftmap {
namespace {

// Far below what a reader accepts, so that one large scan still fits behind it.
constexpr std::int64_t kMaxWriterChunkBytes = std::int64_t{64} << 20;

constexpr std::string_view kEncoding = "protobuf";

Status About(const std::string& path, const Status& status) {
  if (status.ok()) return status;
  return MakeStatus(status.code(), "run log '{}': {}", path, Message(status));
}

// Whether a message is of the topic; an error if the topic carries something else than ours.
StatusOr<bool> IsOn(const RunLogTopic& topic, const mcap::Channel& channel) {
  if (channel.topic != topic.topic) return false;
  if (channel.message_encoding != kEncoding || channel.schema_name != topic.schema_name) {
    return InvalidArgument("topic '{}': {} message '{}', expected {} message '{}'",
                           channel.topic,
                           channel.message_encoding,
                           channel.schema_name,
                           kEncoding,
                           topic.schema_name);
  }
  return true;
}

// Log times are unsigned; the message itself keeps a stamp before 1970.
std::uint64_t LogTime(Stamp stamp) {
  return static_cast<std::uint64_t>(std::max<std::int64_t>(ToNanoseconds(stamp), 0));
}

Status CheckText(const Run& run) {
  if (!IsUtf8(run.info.vehicle)) return InvalidArgument("vehicle is not UTF-8");
  if (!IsUtf8(run.info.source)) return InvalidArgument("source is not UTF-8");
  for (const Scan& scan : run.scans) {
    for (const Observation& observation : scan.observations) {
      if (!IsUtf8(observation.signature.text())) {
        return InvalidArgument("scan at {:.6f} s: a signature is not UTF-8",
                               ToSecondsSinceEpoch(scan.stamp));
      }
    }
  }
  return OkStatus();
}

Status WriteMessages(const Run& run, mcap::Writer* writer) {
  const std::string schema = RunLogSchema();
  const auto add_channel = [&](const RunLogTopic& topic) {
    return writer->AddChannel(
        writer->AddSchema(topic.schema_name, kEncoding, schema), topic.topic, kEncoding);
  };
  const std::uint16_t info = add_channel(kRunInfoTopic);
  const std::uint16_t odometry = add_channel(kOdometryTopic);
  const std::uint16_t landmarks = add_channel(kLandmarksTopic);

  const std::vector<RunEvent> events = MergeEvents(run);
  SHIFTMAP_RETURN_IF_ERROR(
      writer->Write(info, LogTime(StampOf(events.front())), EncodeRunInfo(run.info)));
  for (const RunEvent& event : events) {
    const std::uint64_t time_ns = LogTime(StampOf(event));
    const auto* sample = std::get_if<OdometrySample>(&event);
    SHIFTMAP_RETURN_IF_ERROR(
        sample != nullptr ? writer->Write(odometry, time_ns, EncodeOdometry(*sample))
                          : writer->Write(landmarks, time_ns, EncodeScan(std::get<Scan>(event))));
  }
  return writer->Finish();
}

Status WriteChecked(const Run& run, const std::string& path, const RunLogWriterOptions& options) {
  if (options.chunk_bytes < 1 || options.chunk_bytes > kMaxWriterChunkBytes) {
    return InvalidArgument(
        "chunk size {} bytes, expected 1..{}", options.chunk_bytes, kMaxWriterChunkBytes);
  }
  SHIFTMAP_RETURN_IF_ERROR(ValidateRun(run));
  SHIFTMAP_RETURN_IF_ERROR(CheckText(run));
  SHIFTMAP_ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::Create(path));
  mcap::Writer writer(
      [&file](std::string_view bytes) { return file.Append(bytes); },
      {.compression = options.compress ? mcap::Compression::kZstd : mcap::Compression::kNone,
       .chunk_bytes = static_cast<std::uint64_t>(options.chunk_bytes)});
  SHIFTMAP_RETURN_IF_ERROR(WriteMessages(run, &writer));
  return file.Commit();
}

}  // namespace

struct RunLogStream::State {
  std::string path;
  std::ifstream file;
  std::optional<mcap::Reader> reader;
  RunInfo info;

  Status Open();
  StatusOr<std::optional<RunEvent>> Next();

 private:
  // The item that a message is, if it is one; takes a /run_info into `info`.
  StatusOr<std::optional<RunEvent>> Decode(const mcap::LogMessage& message);
};

Status RunLogStream::State::Open() {
  std::istream* in = &std::cin;
  if (path != "-") {
    SHIFTMAP_ASSIGN_OR_RETURN(file, OpenInputFile(path));
    in = &file;
  }
  SHIFTMAP_ASSIGN_OR_RETURN(reader, mcap::Reader::Open(in));
  return OkStatus();
}

StatusOr<std::optional<RunEvent>> RunLogStream::State::Next() {
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<mcap::LogMessage> message, reader->Next());
    if (!message) return std::optional<RunEvent>();
    SHIFTMAP_ASSIGN_OR_RETURN(std::optional<RunEvent> event, Decode(*message));
    if (event) return event;
  }
}

StatusOr<std::optional<RunEvent>> RunLogStream::State::Decode(const mcap::LogMessage& message) {
  SHIFTMAP_ASSIGN_OR_RETURN(const bool is_odometry, IsOn(kOdometryTopic, *message.channel));
  if (is_odometry) {
    SHIFTMAP_ASSIGN_OR_RETURN(const OdometrySample sample, DecodeOdometry(message.data));
    return std::optional<RunEvent>(sample);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const bool is_scan, IsOn(kLandmarksTopic, *message.channel));
  if (is_scan) {
    SHIFTMAP_ASSIGN_OR_RETURN(Scan scan, DecodeScan(message.data));
    return std::optional<RunEvent>(std::move(scan));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const bool is_info, IsOn(kRunInfoTopic, *message.channel));
  if (is_info) {
    SHIFTMAP_ASSIGN_OR_RETURN(info, DecodeRunInfo(message.data));
  }
  return std::optional<RunEvent>();
}

StatusOr<RunLogStream> RunLogStream::Open(const std::string& path) {
  auto state = std::make_unique<State>();
  state->path = path;
  SHIFTMAP_RETURN_IF_ERROR(About(path, state->Open()));
  return RunLogStream(std::move(state));
}

RunLogStream::RunLogStream(std::unique_ptr<State> state) : state_(std::move(state)) {}
RunLogStream::RunLogStream(RunLogStream&&) noexcept = default;
RunLogStream& RunLogStream::operator=(RunLogStream&&) noexcept = default;
RunLogStream::~RunLogStream() = default;

StatusOr<std::optional<RunEvent>> RunLogStream::Next() {
  auto event = state_->Next();
  if (!event.ok()) return About(state_->path, event.status());
  return event;
}

const RunInfo& RunLogStream::info() const { return state_->info; }

const std::string& RunLogStream::truncation() const { return state_->reader->truncation(); }

StatusOr<RunLog> ReadRunLog(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(RunLogStream stream, RunLogStream::Open(path));
  RunLog log;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(std::optional<RunEvent> event, stream.Next());
    if (!event) break;
    if (const auto* sample = std::get_if<OdometrySample>(&*event)) {
      log.run.odometry.push_back(*sample);
    } else {
      log.run.scans.push_back(std::get<Scan>(*std::move(event)));
    }
  }
  log.run.info = stream.info();
  log.truncation = stream.truncation();
  if (const Status status = ValidateRun(log.run); !status.ok()) {
    return About(path,
                 log.truncation.empty()
                     ? status
                     : MakeStatus(status.code(), "{} ({})", Message(status), log.truncation));
  }
  auto hash = HashFile(path);
  if (!hash.ok()) return About(path, hash.status());
  log.sha256 = *std::move(hash);
  return log;
}

Status WriteRunLog(const Run& run, const std::string& path, const RunLogWriterOptions& options) {
  return About(path, WriteChecked(run, path, options));
}

}  // namespace shiftmap
