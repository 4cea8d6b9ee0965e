// SPDX-License-Identifier: Apache-2.0
#include "localizer/recording/shift_recording.h"

#include <cstdint>
#include <fstream>
#include <utility>

#include "localizer/recording/codec/recording_codec.h"
#include "mapstore/codec/map_message.h"
#include "mapstore/core/input_file.h"
#include "mapstore/core/memory_bound.h"
#include "proto/mcap/reader.h"

namespace shiftmap {
namespace {

// What a message takes in memory, at most, for each of its bytes and by itself.
constexpr std::int64_t kBytesPerByte = 16;
constexpr std::int64_t kBytesPerMessage = 256;

template <typename Item>
Status Append(std::string_view bytes, std::vector<Item>* items) {
  return Decode(bytes, &items->emplace_back());
}

bool IsOn(const RecordingTopic& topic, const mcap::LogMessage& message) {
  return message.channel->topic == topic.topic && message.channel->schema_name == topic.schema_name;
}

class RecordingReader {
 public:
  Status Take(const mcap::LogMessage& message) {
    const auto is = [&](const RecordingTopic& topic) { return IsOn(topic, message); };
    if (!is(kShiftTopic) && !found_) return InvalidArgument("no recording of a shift");
    bytes_left_ -=
        kBytesPerMessage + kBytesPerByte * static_cast<std::int64_t>(message.data.size());
    if (bytes_left_ < 0) return InvalidArgument("takes more memory than there is for it");
    if (is(kShiftTopic)) {
      found_ = true;
      return Decode(message.data, &recording_.shift);
    }
    if (is(kMapTopic)) {
      SHIFTMAP_ASSIGN_OR_RETURN(recording_.map, DecodeMap(message.data, MapForm::kBinary));
    }
    if (is(kPoseEventTopic)) return Append(message.data, &recording_.poses);
    if (is(kStateTopic)) return Append(message.data, &recording_.states);
    if (is(kDecisionTopic)) return Append(message.data, &recording_.decisions);
    if (is(kInnovationTopic)) return Append(message.data, &recording_.innovations);
    if (is(kHypothesesTopic)) return Append(message.data, &recording_.hypotheses);
    return OkStatus();
  }

  StatusOr<ShiftRecording> Finish(const std::string& truncation) {
    if (!found_) return InvalidArgument("no recording of a shift");
    recording_.truncation = truncation;
    return std::move(recording_);
  }

 private:
  ShiftRecording recording_;
  bool found_ = false;
  std::int64_t bytes_left_ = MemoryBound() / 4;
};

StatusOr<ShiftRecording> Read(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(std::ifstream file, OpenInputFile(path));
  SHIFTMAP_ASSIGN_OR_RETURN(mcap::Reader reader, mcap::Reader::Open(&file));
  RecordingReader recording;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<mcap::LogMessage> message, reader.Next());
    if (!message) return recording.Finish(reader.truncation());
    SHIFTMAP_RETURN_IF_ERROR(
        Annotate(recording.Take(*message), "topic '{}'", message->channel->topic));
  }
}

}  // namespace

NisSum GatedNis(const ScanInnovations& scan) {
  NisSum nis;
  for (const RecordedInnovation& innovation : scan.innovations) {
    if (innovation.mode == kAbsent) continue;
    nis.sum += innovation.nis;
    ++nis.updates;
  }
  return nis;
}

bool BeginsAsRecording(const std::string& path) {
  StatusOr<std::ifstream> file = OpenInputFile(path);
  if (!file.ok()) return false;
  StatusOr<mcap::Reader> reader = mcap::Reader::Open(&*file);
  if (!reader.ok()) return false;
  const StatusOr<std::optional<mcap::LogMessage>> first = reader->Next();
  return first.ok() && *first && IsOn(kShiftTopic, **first);
}

StatusOr<ShiftRecording> ReadShiftRecording(const std::string& path) {
  StatusOr<ShiftRecording> recording = Read(path);
  if (recording.ok()) return recording;
  return Annotate(recording.status(), "recording '{}'", path);
}

}  // namespace shiftmap
