// SPDX-License-Identifier: Apache-2.0
#include "mapstore/codec/run_log.h"

#include <algorithm>
#include <fstream>
#include <iostream>
#include <utility>

#include "mapstore/codec/run_log_messages.h"
#include "mapstore/core/atomic_file.h"
#include "mapstore/core/input_file.h"
#include "mapstore/core/memory_bound.h"
#include "mapstore/core/utf8.h"
#include "mapstore/map/sha256.h"
#include "mapstore/map/shift_report_check.h"
#include "proto/mcap/reader.h"
#include "proto/mcap/writer.h"

namespace shiftmap {
namespace {

constexpr std::int64_t kMib = std::int64_t{1} << 20;

// Far below what a reader accepts.
constexpr std::int64_t kMaxWriterChunkBytes = 16 * kMib;

// What of MemoryBound() a run takes by default while it is read.
constexpr std::int64_t kReaderShare = 4;

constexpr std::string_view kEncoding = "protobuf";

Status AboutLog(const std::string& path, const Status& status) {
  return Annotate(status, "run log '{}'", path);
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

Status CheckText(const RunInfo& info) {
  if (!IsUtf8(info.vehicle)) return InvalidArgument("vehicle is not UTF-8");
  if (!IsUtf8(info.source)) return InvalidArgument("source is not UTF-8");
  if (!IsUtf8(info.area)) return InvalidArgument("area is not UTF-8");
  if (!info.uuid.empty() && !IsUuid(info.uuid))
    return InvalidArgument("uuid: not an RFC 4122 UUID");
  return OkStatus();
}

Status CheckText(const Scan& scan) {
  for (const Observation& observation : scan.observations) {
    if (!IsUtf8(observation.signature.text())) {
      return InvalidArgument("scan at {:.6f} s: a signature is not UTF-8",
                             ToSecondsSinceEpoch(scan.stamp));
    }
  }
  return OkStatus();
}

// Puts items into a run as long as it stays within a bound on its memory.
class Collector {
 public:
  // @param run  Borrowed; empty.
  Collector(std::int64_t max_bytes, Run* run) : max_bytes_(max_bytes), run_(run) {}

  Status Add(RunEvent event) {
    if (const auto* sample = std::get_if<OdometrySample>(&event)) {
      SHIFTMAP_RETURN_IF_ERROR(MakeRoom(&run_->odometry));
      run_->odometry.push_back(*sample);
      return OkStatus();
    }
    if (auto* scan = std::get_if<Scan>(&event)) return Add(std::move(*scan), &run_->scans);
    return Add(std::get<LidarScan>(std::move(event)), &run_->lidar_scans);
  }

 private:
  template <typename Item>
  Status Add(Item scan, std::vector<Item>* scans) {
    SHIFTMAP_RETURN_IF_ERROR(MakeRoom(scans));
    bytes_ += HeapBytes(scan);
    scans->push_back(std::move(scan));
    return CheckBound(0);
  }

  static std::int64_t HeapBytes(const LidarScan& scan) {
    return static_cast<std::int64_t>(scan.ranges_m.capacity() * sizeof(float));
  }
  static std::int64_t HeapBytes(const Scan& scan) {
    static const std::size_t kInPlace = std::string().capacity();
    std::size_t bytes = scan.observations.capacity() * sizeof(Observation);
    for (const Observation& observation : scan.observations) {
      const std::size_t text = observation.signature.text().capacity();
      if (text > kInPlace) bytes += text;
    }
    return static_cast<std::int64_t>(bytes);
  }

  // Room for one item more, in a vector that doubles when it is full.
  template <typename Item>
  Status MakeRoom(std::vector<Item>* items) {
    constexpr std::size_t kFirst = 64;
    const std::size_t before = items->capacity();
    if (items->size() < before) return OkStatus();
    const std::size_t after = std::max(kFirst, 2 * before);
    const auto size_of = [](std::size_t count) {
      return static_cast<std::int64_t>(count * sizeof(Item));
    };
    SHIFTMAP_RETURN_IF_ERROR(CheckBound(size_of(after)));
    items->reserve(after);
    bytes_ += size_of(after) - size_of(before);
    return OkStatus();
  }

  Status CheckBound(std::int64_t more_bytes) const {
    if (bytes_ + more_bytes <= max_bytes_) return OkStatus();
    return InvalidArgument("after {} odometry samples and {} scans: takes more than {} MiB",
                           run_->odometry.size(),
                           run_->scans.size() + run_->lidar_scans.size(),
                           max_bytes_ / kMib);
  }

  std::int64_t max_bytes_;
  std::int64_t bytes_ = 0;
  Run* run_;
};

Status CheckSize(const Scan& scan, const std::string& message) {
  if (message.size() <= kMaxItemBytes) return OkStatus();
  return InvalidArgument("scan at {:.6f} s: {} observations take {} bytes, expected at most {}",
                         ToSecondsSinceEpoch(scan.stamp),
                         scan.observations.size(),
                         message.size(),
                         kMaxItemBytes);
}

Status WriteChecked(const Run& run, const std::string& path, const RunLogWriterOptions& options) {
  SHIFTMAP_RETURN_IF_ERROR(ValidateRun(run));
  SHIFTMAP_ASSIGN_OR_RETURN(RunLogWriter writer, RunLogWriter::Create(path, run.info, options));
  SHIFTMAP_RETURN_IF_ERROR(
      ForEachEvent(run, [&](const RunEvent& event) { return writer.Write(event); }));
  return writer.Finish();
}

}  // namespace

struct RunLogWriter::State {
  State(const RunInfo& run, AtomicFile to) : info(run), file(std::move(to)) {}

  RunInfo info;
  AtomicFile file;
  std::optional<mcap::Writer> writer;
  std::uint16_t info_channel = 0;
  std::uint16_t odometry_channel = 0;
  std::uint16_t scan_channel = 0;
  std::uint16_t lidar_channel = 0;
  std::optional<Stamp> newest;
  bool has_odometry = false;

  std::uint16_t AddChannel(const RunLogTopic& topic) {
    const std::uint16_t schema = writer->AddSchema(topic.schema_name, kEncoding, RunLogSchema());
    return writer->AddChannel(schema, topic.topic, kEncoding);
  }

  Status Write(const RunEvent& event);
};

Status RunLogWriter::State::Write(const RunEvent& event) {
  SHIFTMAP_RETURN_IF_ERROR(ValidateEvent(event));
  const Stamp stamp = StampOf(event);
  if (newest && stamp < *newest) {
    return InvalidArgument("item at {:.6f} s after one at {:.6f} s",
                           ToSecondsSinceEpoch(stamp),
                           ToSecondsSinceEpoch(*newest));
  }
  const std::uint64_t time_ns = LogTime(stamp);
  if (!newest) SHIFTMAP_RETURN_IF_ERROR(writer->Write(info_channel, time_ns, EncodeRunInfo(info)));
  newest = stamp;
  if (const auto* sample = std::get_if<OdometrySample>(&event)) {
    has_odometry = true;
    return writer->Write(odometry_channel, time_ns, EncodeOdometry(*sample));
  }
  if (const auto* lidar = std::get_if<LidarScan>(&event)) {
    return writer->Write(lidar_channel, time_ns, EncodeLidarScan(*lidar));
  }
  const Scan& scan = std::get<Scan>(event);
  SHIFTMAP_RETURN_IF_ERROR(CheckText(scan));
  const std::string message = EncodeScan(scan);
  SHIFTMAP_RETURN_IF_ERROR(CheckSize(scan, message));
  return writer->Write(scan_channel, time_ns, message);
}

StatusOr<RunLogWriter> RunLogWriter::Create(const std::string& path,
                                            const RunInfo& info,
                                            const RunLogWriterOptions& options) {
  if (options.chunk_bytes < 1 || options.chunk_bytes > kMaxWriterChunkBytes) {
    return InvalidArgument(
        "chunk size {} bytes, expected 1..{}", options.chunk_bytes, kMaxWriterChunkBytes);
  }
  SHIFTMAP_RETURN_IF_ERROR(CheckText(info));
  SHIFTMAP_ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::Create(path, FileKind::kRunLog));
  auto state = std::make_unique<State>(info, std::move(file));
  state->writer.emplace(
      [to = &state->file](std::string_view bytes) { return to->Append(bytes); },
      mcap::WriterOptions{
          .compression = options.compress ? mcap::Compression::kZstd : mcap::Compression::kNone,
          .chunk_bytes = static_cast<std::uint64_t>(options.chunk_bytes)});
  state->info_channel = state->AddChannel(kRunInfoTopic);
  state->odometry_channel = state->AddChannel(kOdometryTopic);
  state->scan_channel = state->AddChannel(kLandmarksTopic);
  state->lidar_channel = state->AddChannel(kLidarTopic);
  return RunLogWriter(std::move(state));
}

RunLogWriter::RunLogWriter(std::unique_ptr<State> state) : state_(std::move(state)) {}
RunLogWriter::RunLogWriter(RunLogWriter&&) noexcept = default;
RunLogWriter& RunLogWriter::operator=(RunLogWriter&&) noexcept = default;
RunLogWriter::~RunLogWriter() = default;

Status RunLogWriter::Write(const RunEvent& event) { return state_->Write(event); }

bool RunLogWriter::has_odometry() const { return state_->has_odometry; }

Status RunLogWriter::Finish() {
  if (!state_->has_odometry) return InvalidArgument("no odometry");
  SHIFTMAP_RETURN_IF_ERROR(state_->writer->Finish());
  return state_->file.Commit();
}

struct RunLogStream::State {
  std::string path;
  bool lidar_scans = true;
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
  if (lidar_scans) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool is_lidar, IsOn(kLidarTopic, *message.channel));
    if (is_lidar) {
      SHIFTMAP_ASSIGN_OR_RETURN(LidarScan scan, DecodeLidarScan(message.data));
      return std::optional<RunEvent>(std::move(scan));
    }
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const bool is_info, IsOn(kRunInfoTopic, *message.channel));
  if (is_info) {
    SHIFTMAP_ASSIGN_OR_RETURN(info, DecodeRunInfo(message.data));
  }
  return std::optional<RunEvent>();
}

StatusOr<RunLogStream> RunLogStream::Open(const std::string& path, bool lidar_scans) {
  auto state = std::make_unique<State>();
  state->path = path;
  state->lidar_scans = lidar_scans;
  SHIFTMAP_RETURN_IF_ERROR(AboutLog(path, state->Open()));
  return RunLogStream(std::move(state));
}

RunLogStream::RunLogStream(std::unique_ptr<State> state) : state_(std::move(state)) {}
RunLogStream::RunLogStream(RunLogStream&&) noexcept = default;
RunLogStream& RunLogStream::operator=(RunLogStream&&) noexcept = default;
RunLogStream::~RunLogStream() = default;

StatusOr<std::optional<RunEvent>> RunLogStream::Next() {
  auto event = state_->Next();
  if (!event.ok()) return AboutLog(state_->path, event.status());
  return event;
}

const RunInfo& RunLogStream::info() const { return state_->info; }

const std::string& RunLogStream::truncation() const { return state_->reader->truncation(); }

StatusOr<RunLog> ReadRunLog(const std::string& path, const RunLogReaderOptions& options) {
  SHIFTMAP_ASSIGN_OR_RETURN(RunLogStream stream, RunLogStream::Open(path, options.lidar_scans));
  RunLog log;
  Collector collector(options.max_memory_bytes.value_or(MemoryBound() / kReaderShare), &log.run);
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(std::optional<RunEvent> event, stream.Next());
    if (!event) break;
    SHIFTMAP_RETURN_IF_ERROR(AboutLog(path, collector.Add(*std::move(event))));
  }
  log.run.info = stream.info();
  log.truncation = stream.truncation();
  if (const Status status = ValidateRun(log.run); !status.ok()) {
    return AboutLog(path,
                    log.truncation.empty()
                        ? status
                        : MakeStatus(status.code(), "{} ({})", Message(status), log.truncation));
  }
  auto hash = HashFile(path);
  if (!hash.ok()) return AboutLog(path, hash.status());
  log.sha256 = *std::move(hash);
  return log;
}

Status WriteRunLog(const Run& run, const std::string& path, const RunLogWriterOptions& options) {
  return AboutLog(path, WriteChecked(run, path, options));
}

}  // namespace shiftmap
