// SPDX-License-Identifier: Apache-2.0
//
// Follows every offset that our files state, with a walk over all records as the oracle.
#include <gtest/gtest.h>

#include <algorithm>
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
  EXPECT_EQ(Count(Opcode::kSummaryOffset), 3U);
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

// A reader that seeks takes a chunk index without message indexes for an error or for no messages;
// without a chunk index it reads front to back.
TEST_F(McapLayout, HasNoIndex) {
  EXPECT_EQ(Count(Opcode::kMessageIndex), 0U);
  EXPECT_EQ(Count(Opcode::kChunkIndex), 0U);
}

// What a chunk states of itself.
struct ChunkFields {
  std::uint64_t begin_ns = 0;
  std::uint64_t end_ns = 0;
  std::uint64_t size = 0;
  std::string records;
};

ChunkFields ReadChunk(const Record& record) {
  ByteReader reader(record.content);
  ChunkFields chunk;
  chunk.begin_ns = reader.Read<std::uint64_t>();
  chunk.end_ns = reader.Read<std::uint64_t>();
  chunk.size = reader.Read<std::uint64_t>();
  const auto crc = reader.Read<std::uint32_t>();
  const std::string_view compression = reader.String();
  const std::string_view stored = reader.Bytes(reader.Read<std::uint64_t>());
  EXPECT_TRUE(reader.ok() && reader.rest().empty());
  chunk.records = *Decompress(compression, stored, chunk.size);
  EXPECT_EQ(crc, Crc32::Of(chunk.records));
  return chunk;
}

std::vector<ChunkFields> ReadChunks(const std::vector<Record>& records) {
  std::vector<ChunkFields> chunks;
  for (const Record& record : records) {
    if (record.opcode == Opcode::kChunk) chunks.push_back(ReadChunk(record));
  }
  return chunks;
}

std::vector<std::uint64_t> MessageTimes(const ChunkFields& chunk) {
  std::vector<std::uint64_t> times;
  for (const Record& record : Walk(chunk.records, 0)) {
    EXPECT_EQ(record.opcode, Opcode::kMessage);
    ByteReader reader(record.content);
    reader.Bytes(2 + 4);  // Channel and sequence.
    times.push_back(reader.Read<std::uint64_t>());
  }
  return times;
}

TEST_F(McapLayout, ChunksStateWhatTheyHold) {
  const std::vector<ChunkFields> chunks = ReadChunks(records_);
  EXPECT_GT(chunks.size(), 3U);
  std::vector<std::uint64_t> all;
  for (const ChunkFields& chunk : chunks) {
    const std::vector<std::uint64_t> times = MessageTimes(chunk);
    ASSERT_FALSE(times.empty());
    EXPECT_LE(chunk.size, 500U);
    EXPECT_EQ(chunk.begin_ns, *std::min_element(times.begin(), times.end()));
    EXPECT_EQ(chunk.end_ns, *std::max_element(times.begin(), times.end()));
    all.insert(all.end(), times.begin(), times.end());
  }
  ASSERT_EQ(all.size(), messages_.size());
  for (std::size_t i = 0; i < all.size(); ++i) EXPECT_EQ(all[i], messages_[i].time_ns);
}

std::vector<Record> RecordsOf(std::string_view file) {
  return Walk(file.substr(kMagic.size(), file.size() - 2 * kMagic.size()), kMagic.size());
}

// Also where times jump, ahead or back.
TEST(McapChunks, HoldLessThanTheirDuration) {
  auto messages = MakeMessages(300, 20, 23);
  for (std::size_t i = 0; i < messages.size(); ++i) {
    messages[i].time_ns = 5'000'000'000 + i * 20'000'000;
    if (i >= 100) messages[i].time_ns += 40'000'000'000;
    if (i >= 200) messages[i].time_ns -= 43'000'000'000;
    messages[i].publish_time_ns = messages[i].time_ns;
  }
  const std::string file = WriteAll(messages, {});
  const std::vector<ChunkFields> chunks = ReadChunks(RecordsOf(file));
  EXPECT_EQ(chunks.size(), 6U);
  for (const ChunkFields& chunk : chunks) {
    EXPECT_LT(chunk.end_ns - chunk.begin_ns, 1'000'000'000U);
    EXPECT_EQ(MessageTimes(chunk).size(), 50U);
  }
  EXPECT_EQ(ReadAll(file).messages, messages);
  EXPECT_EQ(ReadChunks(RecordsOf(WriteAll(messages, {.chunk_duration_ns = 0}))).size(), 1U);
}

// What a crash leaves behind: the sink has every chunk as soon as the next one begins.
TEST(McapChunks, GoToTheSinkWhenTheyAreClosed) {
  std::string written;
  Writer writer(
      [&written](std::string_view bytes) {
        written.append(bytes);
        return OkStatus();
      },
      {});
  const std::uint16_t schema = writer.AddSchema("s", "protobuf", "");
  const std::uint16_t channel = writer.AddChannel(schema, "/a", "protobuf");
  constexpr std::uint64_t kStepNs = 100'000'000;
  for (std::uint64_t i = 0; i < 200; ++i) {
    ASSERT_TRUE(writer.Write(channel, i * kStepNs, "data").ok());
    const ReadResult result = ReadAll(written);
    ASSERT_TRUE(result.status.ok()) << Message(result.status);
    EXPECT_EQ(result.messages.size(), i / 10 * 10);
  }
}

}  // namespace
}  // namespace shiftmap::mcap
