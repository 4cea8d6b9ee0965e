// SPDX-License-Identifier: Apache-2.0
#include "proto/mcap/writer.h"

#include <algorithm>
#include <array>
#include <utility>

#include "proto/core/check.h"

namespace shiftmap::mcap {
namespace {

constexpr std::string_view kProfile;
constexpr std::string_view kLibrary = "shiftmap";

/// A group of like records in the summary.
struct SummaryGroup {
  Opcode opcode;
  const ByteWriter* records;
};

}  // namespace

Writer::Writer(Sink sink, const WriterOptions& options)
    : sink_(std::move(sink)), options_(options) {
  SHIFTMAP_CHECK(options.chunk_bytes <= kMaxChunkBytes, "chunk_bytes {}", options.chunk_bytes);
  ByteWriter header;
  header.String(kProfile).String(kLibrary);
  ByteWriter out;
  out.Bytes(kMagic).Record(Opcode::kHeader, header.bytes());
  Emit(out.bytes());
}

void Writer::Emit(std::string_view bytes) {
  if (!status_.ok()) return;
  status_ = sink_(bytes);
  data_crc_.Update(bytes);
  position_ += bytes.size();
}

void Writer::EmitDefinition(Opcode opcode, std::string_view content, ByteWriter* summary) {
  ByteWriter record;
  record.Record(opcode, content);
  Emit(record.bytes());
  summary->Bytes(record.bytes());
}

std::uint16_t Writer::AddSchema(std::string_view name,
                                std::string_view encoding,
                                std::string_view data) {
  SHIFTMAP_CHECK(schema_count_ < UINT16_MAX, "too many schemas");
  const std::uint16_t id = ++schema_count_;
  ByteWriter content;
  content.Write(id).String(name).String(encoding).String(data);
  EmitDefinition(Opcode::kSchema, content.bytes(), &schemas_);
  return id;
}

std::uint16_t Writer::AddChannel(std::uint16_t schema_id,
                                 std::string_view topic,
                                 std::string_view message_encoding) {
  SHIFTMAP_CHECK(schema_id <= schema_count_, "schema {} of {}", schema_id, schema_count_);
  SHIFTMAP_CHECK(channel_states_.size() < UINT16_MAX, "too many channels");
  const auto id = static_cast<std::uint16_t>(channel_states_.size() + 1);
  channel_states_[id];
  ByteWriter content;
  content.Write(id).Write(schema_id).String(topic).String(message_encoding);
  content.String({});  // No metadata.
  EmitDefinition(Opcode::kChannel, content.bytes(), &channels_);
  return id;
}

Status Writer::Write(std::uint16_t channel_id, std::uint64_t time_ns, std::string_view data) {
  const auto channel = channel_states_.find(channel_id);
  SHIFTMAP_CHECK(channel != channel_states_.end(), "channel {}", channel_id);
  ByteWriter content;
  content.Write(channel_id).Write(channel->second.sequence).Write(time_ns).Write(time_ns);
  content.Bytes(data);
  const std::uint64_t record_bytes = kRecordHeadBytes + content.size();
  if (record_bytes > kMaxChunkBytes) {
    return InvalidArgument("message of {} bytes, expected at most {}", data.size(), kMaxChunkBytes);
  }
  if (chunk_.size() > 0 && IsFull(record_bytes, time_ns)) FlushChunk();

  if (options_.chunk_bytes == 0) {
    ByteWriter record;
    record.Record(Opcode::kMessage, content.bytes());
    Emit(record.bytes());
  } else {
    chunk_start_ns_ = chunk_.size() == 0 ? time_ns : std::min(chunk_start_ns_, time_ns);
    chunk_end_ns_ = chunk_.size() == 0 ? time_ns : std::max(chunk_end_ns_, time_ns);
    chunk_.Record(Opcode::kMessage, content.bytes());
  }
  ++channel->second.sequence;
  ++channel->second.messages;
  start_ns_ = message_count_ == 0 ? time_ns : std::min(start_ns_, time_ns);
  end_ns_ = message_count_ == 0 ? time_ns : std::max(end_ns_, time_ns);
  ++message_count_;
  return status_;
}

bool Writer::IsFull(std::uint64_t record_bytes, std::uint64_t time_ns) const {
  if (chunk_.size() + record_bytes > options_.chunk_bytes) return true;
  if (options_.chunk_duration_ns == 0) return false;
  const std::uint64_t begin_ns = std::min(chunk_start_ns_, time_ns);
  const std::uint64_t end_ns = std::max(chunk_end_ns_, time_ns);
  return end_ns - begin_ns >= options_.chunk_duration_ns;
}

void Writer::FlushChunk() {
  const StatusOr<std::string> records = Compress(options_.compression, chunk_.bytes());
  if (!records.ok()) {
    if (status_.ok()) status_ = records.status();
    return;
  }
  ByteWriter content;
  content.Write(chunk_start_ns_).Write(chunk_end_ns_).Write(chunk_.size());
  content.Write(Crc32::Of(chunk_.bytes())).String(CompressionName(options_.compression));
  content.Write(static_cast<std::uint64_t>(records->size())).Bytes(*records);
  ByteWriter chunk;
  chunk.Record(Opcode::kChunk, content.bytes());
  Emit(chunk.bytes());
  ++chunk_count_;
  chunk_.Clear();
}

ByteWriter Writer::Statistics() const {
  ByteWriter counts;
  for (const auto& [id, channel] : channel_states_) {
    if (channel.messages > 0) counts.Write(id).Write(channel.messages);
  }
  constexpr std::uint32_t kNoAttachments = 0;
  constexpr std::uint32_t kNoMetadata = 0;
  ByteWriter content;
  content.Write(message_count_).Write(schema_count_);
  content.Write(static_cast<std::uint32_t>(channel_states_.size()));
  content.Write(kNoAttachments).Write(kNoMetadata).Write(chunk_count_);
  content.Write(start_ns_).Write(end_ns_).String(counts.bytes());
  ByteWriter record;
  record.Record(Opcode::kStatistics, content.bytes());
  return record;
}

Status Writer::Finish() {
  if (chunk_.size() > 0) FlushChunk();
  ByteWriter data_end;
  data_end.Write(data_crc_.value());
  ByteWriter end;
  end.Record(Opcode::kDataEnd, data_end.bytes());
  Emit(end.bytes());

  const std::uint64_t summary_begin = position_;
  const ByteWriter statistics = Statistics();
  ByteWriter summary;
  ByteWriter offsets;
  for (const SummaryGroup& group : std::array<SummaryGroup, 3>{{
           {Opcode::kSchema, &schemas_},
           {Opcode::kChannel, &channels_},
           {Opcode::kStatistics, &statistics},
       }}) {
    if (group.records->size() == 0) continue;
    ByteWriter content;
    content.Write(static_cast<std::uint8_t>(group.opcode));
    content.Write(summary_begin + summary.size()).Write(group.records->size());
    offsets.Record(Opcode::kSummaryOffset, content.bytes());
    summary.Bytes(group.records->bytes());
  }
  const std::uint64_t offsets_begin = summary_begin + summary.size();
  summary.Bytes(offsets.bytes());
  summary.Write(static_cast<std::uint8_t>(Opcode::kFooter)).Write(kFooterBytes);
  summary.Write(summary_begin).Write(offsets_begin);
  summary.Write(Crc32::Of(summary.bytes())).Bytes(kMagic);
  Emit(summary.bytes());
  return status_;
}

}  // namespace shiftmap::mcap
