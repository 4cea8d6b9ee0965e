// SPDX-License-Identifier: Apache-2.0
#include "proto/mcap/reader.h"

#include <utility>

#include "proto/mcap/byte_reader.h"
#include "proto/mcap/byte_source.h"
#include "proto/mcap/compression.h"
#include "proto/mcap/crc32.h"
#include "proto/mcap/definitions.h"
#include "proto/mcap/format.h"

namespace shiftmap::mcap {

class Reader::State {
 public:
  explicit State(std::istream* in) : source_(in) {}

  Status ReadHeader();
  StatusOr<std::optional<LogMessage>> Next();
  const std::string& truncation() const { return truncation_; }

 private:
  // Takes one record off the stream. Leaves its message, if it is one, in message_.
  Status ReadRecord();
  Status TakeRecord(Opcode opcode, std::string_view content);
  // Takes one record off the open chunk.
  Status ReadChunkRecord();

  Status OpenChunk(std::string_view content);
  Status TakeMessage(std::string_view content);
  Status TakeDataEnd(std::string_view content, std::uint32_t crc_before);
  Status ReadFooter(std::uint64_t length);

  // Puts the byte of the record at hand before a message.
  Status At(const Status& status) const { return Annotate(status, "byte {}", record_begin_); }
  void EndEarly();

  ByteSource source_;
  Definitions definitions_;
  std::uint64_t record_begin_ = 0;
  std::string content_;               // Of the record at hand.
  std::string chunk_;                 // Records of the open chunk,
  std::string_view chunk_rest_;       // and those not read yet.
  std::uint64_t expanded_bytes_ = 0;  // Of all chunks so far.
  std::optional<LogMessage> message_;
  std::uint64_t summary_begin_ = 0;
  bool data_ended_ = false;
  bool done_ = false;
  std::string truncation_;
};

void Reader::State::EndEarly() {
  done_ = true;
  truncation_ =
      fmt::format("the file ends early, at byte {}; its last whole record ends at byte {}{}",
                  source_.position(),
                  record_begin_,
                  data_ended_ ? ", behind all messages" : "");
}

Status Reader::State::ReadHeader() {
  std::string magic;
  SHIFTMAP_ASSIGN_OR_RETURN(const bool whole, source_.Read(kMagic.size(), &magic));
  if (!whole || magic != kMagic) {
    return InvalidArgument("not an mcap file: its first {} bytes are not mcap's", kMagic.size());
  }
  record_begin_ = source_.position();
  return OkStatus();
}

StatusOr<std::optional<LogMessage>> Reader::State::Next() {
  message_.reset();
  while (!done_ && !message_) {
    const Status status = At(chunk_rest_.empty() ? ReadRecord() : ReadChunkRecord());
    if (!status.ok()) {
      done_ = true;
      return status;
    }
  }
  return message_;
}

Status Reader::State::ReadRecord() {
  record_begin_ = source_.position();
  const std::uint32_t crc_before = source_.crc();
  content_.clear();
  SHIFTMAP_ASSIGN_OR_RETURN(const bool has_head, source_.Read(kRecordHeadBytes, &content_));
  if (!has_head) {
    EndEarly();
    return OkStatus();
  }
  ByteReader head(content_);
  const auto opcode = static_cast<Opcode>(head.Read<std::uint8_t>());
  const auto length = head.Read<std::uint64_t>();
  if (opcode == Opcode::kFooter) return ReadFooter(length);

  const bool needed = opcode == Opcode::kSchema || opcode == Opcode::kChannel ||
                      opcode == Opcode::kMessage || opcode == Opcode::kChunk ||
                      opcode == Opcode::kDataEnd || opcode == Opcode::kHeader;
  if (needed && length > kMaxRecordBytes) {
    return DataLoss("record of {} bytes, expected at most {}", length, kMaxRecordBytes);
  }
  if (opcode == Opcode::kInvalid) return DataLoss("record type 0, which does not exist");

  content_.clear();
  SHIFTMAP_ASSIGN_OR_RETURN(const bool whole,
                            needed ? source_.Read(length, &content_) : source_.Skip(length));
  if (!whole) {
    EndEarly();
    return OkStatus();
  }
  if (opcode == Opcode::kDataEnd) return TakeDataEnd(content_, crc_before);
  return needed ? TakeRecord(opcode, content_) : OkStatus();
}

Status Reader::State::TakeRecord(Opcode opcode, std::string_view content) {
  // The summary repeats definitions for readers that seek; they say nothing that is needed here.
  switch (opcode) {
    case Opcode::kSchema:
      return data_ended_ ? OkStatus() : definitions_.AddSchema(content);
    case Opcode::kChannel:
      return data_ended_ ? OkStatus() : definitions_.AddChannel(content);
    case Opcode::kMessage:
      return TakeMessage(content);
    case Opcode::kChunk:
      return OpenChunk(content);
    default:
      return OkStatus();
  }
}

Status Reader::State::OpenChunk(std::string_view content) {
  if (data_ended_) return DataLoss("chunk behind the end of the data");
  ByteReader reader(content);
  reader.Read<std::uint64_t>();  // Start and end time.
  reader.Read<std::uint64_t>();
  const auto size = reader.Read<std::uint64_t>();
  const auto crc = reader.Read<std::uint32_t>();
  const std::string_view compression = reader.String();
  const std::string_view records = reader.Bytes(reader.Read<std::uint64_t>());
  if (!reader.ok()) return DataLoss("chunk: fields beyond its {} bytes", content.size());
  if (size > kMaxChunkBytes) {
    return DataLoss("chunk of {} bytes, expected at most {}", size, kMaxChunkBytes);
  }
  expanded_bytes_ += size;
  const std::uint64_t allowed = kFreeExpansionBytes + kMaxExpansion * source_.position();
  if (expanded_bytes_ > allowed) {
    return DataLoss("the chunks up to here hold {} bytes, expected at most {} in a file of {}",
                    expanded_bytes_,
                    allowed,
                    source_.position());
  }
  auto bytes = Decompress(compression, records, size);
  SHIFTMAP_RETURN_IF_ERROR(Annotate(bytes.status(), "chunk"));
  if (const std::uint32_t actual = Crc32::Of(*bytes); crc != 0 && actual != crc) {
    return DataLoss("chunk: crc {:#010x}, expected {:#010x}", actual, crc);
  }
  chunk_ = *std::move(bytes);
  chunk_rest_ = chunk_;
  return OkStatus();
}

Status Reader::State::ReadChunkRecord() {
  ByteReader reader(chunk_rest_);
  const auto opcode = static_cast<Opcode>(reader.Read<std::uint8_t>());
  const std::string_view content = reader.Bytes(reader.Read<std::uint64_t>());
  if (!reader.ok()) return DataLoss("chunk: a record reaches beyond its end");
  chunk_rest_ = reader.rest();
  if (opcode == Opcode::kInvalid || opcode == Opcode::kChunk) {
    return DataLoss("chunk: record type {} inside", static_cast<int>(opcode));
  }
  return TakeRecord(opcode, content);
}

Status Reader::State::TakeMessage(std::string_view content) {
  if (data_ended_) return DataLoss("message behind the end of the data");
  ByteReader reader(content);
  const auto channel_id = reader.Read<std::uint16_t>();
  LogMessage message;
  message.sequence = reader.Read<std::uint32_t>();
  message.log_time_ns = reader.Read<std::uint64_t>();
  message.publish_time_ns = reader.Read<std::uint64_t>();
  message.data = reader.rest();
  if (!reader.ok()) return DataLoss("message: fields beyond its {} bytes", content.size());
  message.channel = definitions_.FindChannel(channel_id);
  if (message.channel == nullptr) return DataLoss("message: channel {} is not defined", channel_id);
  message_ = message;
  return OkStatus();
}

Status Reader::State::TakeDataEnd(std::string_view content, std::uint32_t crc_before) {
  if (data_ended_) return DataLoss("a second end of the data");
  ByteReader reader(content);
  const auto crc = reader.Read<std::uint32_t>();
  if (!reader.ok()) return DataLoss("data end: fields beyond its {} bytes", content.size());
  if (crc != 0 && crc != crc_before) {
    return DataLoss("data: crc {:#010x}, expected {:#010x}", crc_before, crc);
  }
  data_ended_ = true;
  summary_begin_ = source_.position();
  source_.ResetCrc();
  return OkStatus();
}

Status Reader::State::ReadFooter(std::uint64_t length) {
  if (!data_ended_) return DataLoss("footer without an end of the data");
  if (length != kFooterBytes) return DataLoss("footer of {} bytes, expected 20", length);
  std::string footer;
  SHIFTMAP_ASSIGN_OR_RETURN(bool whole, source_.Read(kFooterBytes - 4, &footer));
  // The CRC covers the summary and the footer up to itself.
  const std::uint32_t actual = source_.crc();
  if (whole) {
    SHIFTMAP_ASSIGN_OR_RETURN(whole, source_.Read(4 + kMagic.size(), &footer));
  }
  if (!whole) {
    EndEarly();
    return OkStatus();
  }
  ByteReader reader(footer);
  const auto summary_begin = reader.Read<std::uint64_t>();
  reader.Read<std::uint64_t>();
  const auto crc = reader.Read<std::uint32_t>();
  const std::uint64_t expected_begin = record_begin_ == summary_begin_ ? 0 : summary_begin_;
  if (summary_begin != 0 && summary_begin != expected_begin) {
    return DataLoss("footer: summary at byte {}, expected {}", summary_begin, expected_begin);
  }
  if (crc != 0 && crc != actual) {
    return DataLoss("summary: crc {:#010x}, expected {:#010x}", actual, crc);
  }
  if (reader.rest() != kMagic) return DataLoss("footer: mcap's last 8 bytes do not follow");

  done_ = true;
  std::string more;
  SHIFTMAP_ASSIGN_OR_RETURN(const bool trailing, source_.Read(1, &more));
  if (trailing) return DataLoss("bytes behind the end of the file");
  return OkStatus();
}

StatusOr<Reader> Reader::Open(std::istream* in) {
  auto state = std::make_unique<State>(in);
  SHIFTMAP_RETURN_IF_ERROR(state->ReadHeader());
  return Reader(std::move(state));
}

Reader::Reader(std::unique_ptr<State> state) : state_(std::move(state)) {}
Reader::Reader(Reader&&) noexcept = default;
Reader& Reader::operator=(Reader&&) noexcept = default;
Reader::~Reader() = default;

StatusOr<std::optional<LogMessage>> Reader::Next() { return state_->Next(); }

const std::string& Reader::truncation() const { return state_->truncation(); }

}  // namespace shiftmap::mcap
