// SPDX-License-Identifier: Apache-2.0
//
// Follows every offset that our files state for readers that seek, with a walk over all records as
// the oracle.
#include <gtest/gtest.h>

#include <map>

#include "proto/mcap/byte_reader.h"
#include "proto/mcap/compression.h"
#include "proto/mcap/crc32.h"
#include "proto/mcap/format.h"
#include "tests/unit/proto/mcap_test_util.h"

namespace shiftmap::mcap {
namespace {

struct Record {
  std::uint64_t begin;
  Opcode opcode;
  std::string_view content;
  std::uint64_t end() const { return begin + kRecordHeadBytes + content.size(); }
};

std::vector<Record> Walk(std::string_view bytes, std::uint64_t begin) {
  std::vector<Record> records;
  ByteReader reader(bytes);
  while (!reader.rest().empty()) {
    Record record;
    record.begin = begin + bytes.size() - reader.rest().size();
    record.opcode = static_cast<Opcode>(reader.Read<std::uint8_t>());
    record.content = reader.Bytes(reader.Read<std::uint64_t>());
    EXPECT_TRUE(reader.ok());
    if (!reader.ok()) break;
    records.push_back(record);
  }
  return records;
}

class McapLayout : public testing::Test {
 protected:
  void SetUp() override {
    messages_ = MakeMessages(60, 100, 22);
    file_ = WriteAll(messages_, {Compression::kZstd, 500});
    const std::string_view file = file_;
    ASSERT_TRUE(file.starts_with(kMagic));
    ASSERT_TRUE(file.ends_with(kMagic));
    records_ = Walk(file.substr(kMagic.size(), file.size() - 2 * kMagic.size()), kMagic.size());
    for (const Record& record : records_) by_begin_[record.begin] = record;
  }

  const Record& Only(Opcode opcode) const {
    const Record* found = nullptr;
    for (const Record& record : records_) {
      if (record.opcode != opcode) continue;
      EXPECT_EQ(found, nullptr) << "twice";
      found = &record;
    }
    EXPECT_NE(found, nullptr);
    return *found;
  }

  std::uint64_t Count(Opcode opcode) const {
    std::uint64_t count = 0;
    for (const Record& record : records_) count += record.opcode == opcode ? 1 : 0;
    return count;
  }

  std::vector<TestMessage> messages_;
  std::string file_;
  std::vector<Record> records_;
  std::map<std::uint64_t, Record> by_begin_;
};

TEST_F(McapLayout, FooterPointsAtSummaryAndItsOffsets) {
  const Record& footer = Only(Opcode::kFooter);
  EXPECT_EQ(footer.begin, records_.back().begin);
  ByteReader reader(footer.content);
  const auto summary = reader.Read<std::uint64_t>();
  const auto offsets = reader.Read<std::uint64_t>();
  const auto crc = reader.Read<std::uint32_t>();
  EXPECT_EQ(summary, Only(Opcode::kDataEnd).end());
  EXPECT_EQ(by_begin_.at(offsets).opcode, Opcode::kSummaryOffset);
  const std::uint64_t crc_begin = footer.end() - 4;
  EXPECT_EQ(crc, Crc32::Of(std::string_view(file_).substr(summary, crc_begin - summary)));
}

TEST_F(McapLayout, DataEndHasTheCrcOfAllBytesBefore) {
  const Record& end = Only(Opcode::kDataEnd);
  EXPECT_EQ(ByteReader(end.content).Read<std::uint32_t>(),
            Crc32::Of(std::string_view(file_).substr(0, end.begin)));
}

TEST_F(McapLayout, SummaryOffsetsCoverTheirGroups) {
  EXPECT_EQ(Count(Opcode::kSummaryOffset), 4U);
  for (const Record& record : records_) {
    if (record.opcode != Opcode::kSummaryOffset) continue;
    ByteReader reader(record.content);
    const auto opcode = static_cast<Opcode>(reader.Read<std::uint8_t>());
    const auto begin = reader.Read<std::uint64_t>();
    const auto length = reader.Read<std::uint64_t>();
    for (const Record& member : Walk(std::string_view(file_).substr(begin, length), begin)) {
      EXPECT_EQ(member.opcode, opcode);
    }
    const auto next = by_begin_.find(begin + length);
    ASSERT_NE(next, by_begin_.end());
    EXPECT_NE(next->second.opcode, opcode) << "the group goes on";
  }
}

TEST_F(McapLayout, StatisticsCountTheFile) {
  ByteReader reader(Only(Opcode::kStatistics).content);
  EXPECT_EQ(reader.Read<std::uint64_t>(), messages_.size());
  EXPECT_EQ(reader.Read<std::uint16_t>(), 2);   // Schemas.
  EXPECT_EQ(reader.Read<std::uint32_t>(), 2U);  // Channels.
  EXPECT_EQ(reader.Read<std::uint32_t>(), 0U);  // Attachments.
  EXPECT_EQ(reader.Read<std::uint32_t>(), 0U);  // Metadata.
  EXPECT_EQ(reader.Read<std::uint32_t>(), Count(Opcode::kChunk));
  EXPECT_EQ(reader.Read<std::uint64_t>(), messages_.front().time_ns);
  EXPECT_EQ(reader.Read<std::uint64_t>(), messages_.back().time_ns);
  std::uint64_t sum = 0;
  ByteReader counts(reader.String());
  while (!counts.rest().empty()) {
    counts.Read<std::uint16_t>();
    sum += counts.Read<std::uint64_t>();
  }
  EXPECT_EQ(sum, messages_.size());
  EXPECT_TRUE(reader.ok() && counts.ok());
}

TEST_F(McapLayout, EveryMessageIsFoundThroughTheIndex) {
  EXPECT_GT(Count(Opcode::kChunk), 3U);
  EXPECT_EQ(Count(Opcode::kChunkIndex), Count(Opcode::kChunk));
  std::map<std::uint64_t, TestMessage> by_time;  // Times are unique here.
  for (const TestMessage& message : messages_) by_time[message.time_ns] = message;

  std::size_t found = 0;
  for (const Record& index : records_) {
    if (index.opcode != Opcode::kChunkIndex) continue;
    ByteReader reader(index.content);
    const auto start_ns = reader.Read<std::uint64_t>();
    const auto end_ns = reader.Read<std::uint64_t>();
    const Record& chunk = by_begin_.at(reader.Read<std::uint64_t>());
    EXPECT_EQ(chunk.opcode, Opcode::kChunk);
    EXPECT_EQ(reader.Read<std::uint64_t>(), chunk.end() - chunk.begin);
    ByteReader offsets(reader.String());
    const auto index_bytes = reader.Read<std::uint64_t>();

    ByteReader fields(chunk.content);
    EXPECT_EQ(fields.Read<std::uint64_t>(), start_ns);
    EXPECT_EQ(fields.Read<std::uint64_t>(), end_ns);
    const auto size = fields.Read<std::uint64_t>();
    fields.Read<std::uint32_t>();
    const std::string_view compression = fields.String();
    const auto stored = fields.Read<std::uint64_t>();
    const auto records = Decompress(compression, fields.Bytes(stored), size);
    ASSERT_TRUE(records.ok());
    EXPECT_EQ(reader.String(), compression);
    EXPECT_EQ(reader.Read<std::uint64_t>(), stored);
    EXPECT_EQ(reader.Read<std::uint64_t>(), size);

    std::uint64_t indexed_bytes = 0;
    while (!offsets.rest().empty()) {
      const auto channel = offsets.Read<std::uint16_t>();
      const Record& message_index = by_begin_.at(offsets.Read<std::uint64_t>());
      EXPECT_EQ(message_index.opcode, Opcode::kMessageIndex);
      indexed_bytes += message_index.end() - message_index.begin;
      ByteReader content(message_index.content);
      EXPECT_EQ(content.Read<std::uint16_t>(), channel);
      ByteReader entries(content.String());
      while (!entries.rest().empty()) {
        const auto time_ns = entries.Read<std::uint64_t>();
        const auto offset = entries.Read<std::uint64_t>();
        EXPECT_TRUE(start_ns <= time_ns && time_ns <= end_ns);
        ByteReader message(std::string_view(*records).substr(offset));
        EXPECT_EQ(message.Read<std::uint8_t>(), static_cast<std::uint8_t>(Opcode::kMessage));
        const std::string_view body = message.Bytes(message.Read<std::uint64_t>());
        EXPECT_EQ(body.substr(2 + 4 + 8 + 8), by_time.at(time_ns).data);
        ++found;
      }
    }
    EXPECT_EQ(indexed_bytes, index_bytes);
  }
  EXPECT_EQ(found, messages_.size());
}

}  // namespace
}  // namespace shiftmap::mcap
