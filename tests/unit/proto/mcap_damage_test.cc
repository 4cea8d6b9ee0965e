// SPDX-License-Identifier: Apache-2.0
//
// What a reader makes of files that are cut off, damaged or made to harm. The rule: an error, or a
// note of truncation with a prefix of the messages, or all the messages; never others unnoticed.
#include <gtest/gtest.h>

#include "proto/mcap/byte_writer.h"
#include "proto/mcap/compression.h"
#include "proto/mcap/crc32.h"
#include "proto/mcap/format.h"
#include "tests/unit/proto/mcap_test_util.h"

namespace shiftmap::mcap {
namespace {

constexpr unsigned kSeed = 21;

// A few chunks, so that damage has a middle.
const std::vector<WriterOptions>& SmallFiles() {
  static const std::vector<WriterOptions> options = {
      {Compression::kNone, 0}, {Compression::kNone, 200}, {Compression::kZstd, 200}};
  return options;
}

TEST(McapDamage, EveryTruncationGivesAPrefixAndSaysSo) {
  const auto messages = MakeMessages(12, 60, kSeed);
  for (const WriterOptions& options : SmallFiles()) {
    const std::string file = WriteAll(messages, options);
    std::size_t most = 0;
    for (std::size_t length = 0; length < file.size(); ++length) {
      const ReadResult result = ReadAll(file.substr(0, length));
      if (length < kMagic.size()) {
        EXPECT_EQ(result.status.code(), StatusCode::kInvalidArgument) << length;
        continue;
      }
      ASSERT_TRUE(result.status.ok()) << length << ": " << Message(result.status);
      EXPECT_NE(result.truncation.find("at byte " + std::to_string(length)), std::string::npos)
          << result.truncation;
      EXPECT_TRUE(IsPrefix(result.messages, messages)) << length;
      EXPECT_GE(result.messages.size(), most) << "a longer file gave less, at " << length;
      most = result.messages.size();
    }
    EXPECT_EQ(most, messages.size()) << "only the index was cut off";
  }
}

TEST(McapDamage, NoFlippedBitGoesUnnoticed) {
  const auto messages = MakeMessages(12, 60, kSeed);
  for (const WriterOptions& options : SmallFiles()) {
    const std::string file = WriteAll(messages, options);
    for (std::size_t bit = 0; bit < 8 * file.size(); ++bit) {
      std::string damaged = file;
      damaged[bit / 8] = static_cast<char>(damaged[bit / 8] ^ (1 << (bit % 8)));
      const ReadResult result = ReadAll(damaged);
      if (!result.status.ok()) continue;
      EXPECT_NE(result.truncation, "") << "bit " << bit;
      // Outside chunks only the data's CRC guards a message, and a file that ends early has none.
      if (options.chunk_bytes == 0) continue;
      EXPECT_TRUE(IsPrefix(result.messages, messages)) << "bit " << bit;
    }
  }
}

TEST(McapDamage, AFlippedBitInAChunkIsDataLossBeforeItsMessages) {
  const auto messages = MakeMessages(12, 60, kSeed);
  const std::string file = WriteAll(messages, {Compression::kNone, 200});
  // Of a message late in the file.
  const std::size_t at = file.rfind(messages[10].data);
  ASSERT_NE(at, std::string::npos);
  ASSERT_FALSE(messages[10].data.empty());
  std::string damaged = file;
  damaged[at] = static_cast<char>(damaged[at] ^ 1);
  const ReadResult result = ReadAll(damaged);
  EXPECT_EQ(result.status.code(), StatusCode::kDataLoss);
  EXPECT_NE(Message(result.status).find("crc"), std::string::npos) << Message(result.status);
  EXPECT_TRUE(IsPrefix(result.messages, messages));
  EXPECT_LE(result.messages.size(), 10U);
  EXPECT_GT(result.messages.size(), 0U);
}

TEST(McapDamage, EmptyAndForeignFilesAreNotMcap) {
  for (const std::string& bytes : {std::string(),
                                   std::string("SQLite format 3\0", 16),
                                   std::string(100, '\0'),
                                   std::string("#ROSBAG V2.0\n and more")}) {
    EXPECT_EQ(ReadAll(bytes).status.code(), StatusCode::kInvalidArgument);
  }
}

TEST(McapDamage, BytesBehindTheEndAreAnError) {
  const std::string file = WriteAll(MakeMessages(3, 10, kSeed), {});
  EXPECT_EQ(ReadAll(file + file).status.code(), StatusCode::kDataLoss);
}

// Files made by hand.
std::string Begin() {
  ByteWriter header;
  header.String("").String("test");
  ByteWriter file;
  file.Bytes(kMagic).Record(Opcode::kHeader, header.bytes());
  return file.bytes();
}

std::string RecordHead(Opcode opcode, std::uint64_t length) {
  ByteWriter head;
  head.Write(static_cast<std::uint8_t>(opcode)).Write(length);
  return head.bytes();
}

std::string ChannelRecord(std::uint16_t id, std::string_view topic) {
  ByteWriter content;
  content.Write(id).Write(std::uint16_t{0}).String(topic).String("protobuf").String("");
  ByteWriter record;
  record.Record(Opcode::kChannel, content.bytes());
  return record.bytes();
}

std::string MessageRecord(std::uint16_t channel) {
  ByteWriter content;
  content.Write(channel).Write(std::uint32_t{0}).Write(std::uint64_t{1}).Write(std::uint64_t{1});
  ByteWriter record;
  record.Record(Opcode::kMessage, content.Bytes("data").bytes());
  return record.bytes();
}

std::string ChunkRecord(std::string_view records,
                        std::uint64_t size,
                        std::uint32_t crc,
                        std::string_view compression) {
  ByteWriter content;
  content.Write(std::uint64_t{0}).Write(std::uint64_t{0}).Write(size).Write(crc);
  content.String(compression).Write(static_cast<std::uint64_t>(records.size())).Bytes(records);
  ByteWriter record;
  record.Record(Opcode::kChunk, content.bytes());
  return record.bytes();
}

TEST(McapHostile, HugeLengthsAreErrorsOrTruncationWithoutTheMemory) {
  for (const Opcode opcode :
       {Opcode::kSchema, Opcode::kChannel, Opcode::kMessage, Opcode::kChunk, Opcode::kDataEnd}) {
    for (const std::uint64_t length : {kMaxRecordBytes + 1, std::uint64_t{1} << 40, UINT64_MAX}) {
      EXPECT_EQ(ReadAll(Begin() + RecordHead(opcode, length) + "x").status.code(),
                StatusCode::kDataLoss);
    }
    const ReadResult result = ReadAll(Begin() + RecordHead(opcode, kMaxRecordBytes) + "x");
    EXPECT_TRUE(result.status.ok());
    EXPECT_NE(result.truncation, "");
  }
  const ReadResult skipped = ReadAll(Begin() + RecordHead(Opcode::kAttachment, UINT64_MAX) + "x");
  EXPECT_TRUE(skipped.status.ok());
  EXPECT_NE(skipped.truncation, "");
}

TEST(McapHostile, LengthsInsideAChunkStayInside) {
  const std::string records = RecordHead(Opcode::kMessage, UINT64_MAX) + "abc";
  EXPECT_EQ(ReadAll(Begin() + ChunkRecord(records, records.size(), 0, "")).status.code(),
            StatusCode::kDataLoss);
  EXPECT_EQ(ReadAll(Begin() + ChunkRecord("", kMaxChunkBytes + 1, 0, "")).status.code(),
            StatusCode::kDataLoss);
  EXPECT_EQ(ReadAll(Begin() + ChunkRecord("", kMaxChunkBytes, 0, "zstd")).status.code(),
            StatusCode::kDataLoss);
}

// Time and memory are in proportion to the file, also for what is skipped.
TEST(McapHostile, ChunksExpandInProportionToTheFile) {
  ByteWriter skipped;
  skipped.Record(static_cast<Opcode>(0x7f), "");
  std::string records;
  while (records.size() < std::size_t{32} << 20) records += skipped.bytes();
  const std::string stored = *Compress(Compression::kZstd, records);
  ASSERT_LT(stored.size(), 10'000U);
  const std::string chunk = ChunkRecord(stored, records.size(), 0, "zstd");
  EXPECT_TRUE(ReadAll(Begin() + chunk).status.ok());
  const Status status = ReadAll(Begin() + chunk + chunk + chunk).status;
  EXPECT_EQ(status.code(), StatusCode::kDataLoss);
  EXPECT_NE(Message(status).find("the chunks up to here hold"), std::string::npos);
  // Other bytes of the file count: it is as long to read.
  const std::string other = RecordHead(Opcode::kAttachment, 1 << 20) + std::string(1 << 20, 'x');
  EXPECT_TRUE(ReadAll(Begin() + other + chunk + chunk + chunk).status.ok());
}

TEST(McapHostile, AChunkInAChunkIsAnError) {
  const std::string inner = ChunkRecord("", 0, 0, "");
  EXPECT_EQ(ReadAll(Begin() + ChunkRecord(inner, inner.size(), 0, "")).status.code(),
            StatusCode::kDataLoss);
}

TEST(McapHostile, AMessageNeedsItsChannel) {
  EXPECT_EQ(ReadAll(Begin() + MessageRecord(1)).status.code(), StatusCode::kDataLoss);
  const ReadResult result = ReadAll(Begin() + ChannelRecord(1, "/a") + MessageRecord(1));
  EXPECT_TRUE(result.status.ok());
  EXPECT_EQ(result.messages.size(), 1U);
}

TEST(McapHostile, AChannelKeepsItsMeaning) {
  EXPECT_TRUE(ReadAll(Begin() + ChannelRecord(1, "/a") + ChannelRecord(1, "/a")).status.ok());
  EXPECT_EQ(ReadAll(Begin() + ChannelRecord(1, "/a") + ChannelRecord(1, "/b")).status.code(),
            StatusCode::kDataLoss);
}

TEST(McapHostile, DefinitionsHaveALimitTogether) {
  std::string file = Begin();
  const std::string topic(8 << 20, 't');
  for (std::uint16_t id = 1; id <= 9; ++id) file += ChannelRecord(id, topic);
  EXPECT_EQ(ReadAll(file).status.code(), StatusCode::kDataLoss);
}

TEST(McapReaderRules, NamesTheCompressionThatItCannotRead) {
  const Status status = ReadAll(Begin() + ChunkRecord("abc", 9, 0, "bz2")).status;
  EXPECT_EQ(status.code(), StatusCode::kInvalidArgument);
  EXPECT_NE(Message(status).find("'bz2'"), std::string::npos);
}

TEST(McapReaderRules, SkipsRecordsThatItDoesNotKnow) {
  ByteWriter unknown;
  unknown.Record(static_cast<Opcode>(0x7f), "of a later version");
  unknown.Record(static_cast<Opcode>(0xf0), "private");
  unknown.Record(Opcode::kMetadata, "anything");
  const std::string records = unknown.bytes() + MessageRecord(1) + unknown.bytes();
  const ReadResult result =
      ReadAll(Begin() + unknown.bytes() + ChannelRecord(1, "/a") +
              ChunkRecord(records, records.size(), Crc32::Of(records), "") + unknown.bytes());
  EXPECT_TRUE(result.status.ok()) << Message(result.status);
  EXPECT_EQ(result.messages.size(), 1U);
}

TEST(McapReaderRules, ACrcOfZeroIsNotStated) {
  const std::string records = MessageRecord(1);
  const ReadResult result =
      ReadAll(Begin() + ChannelRecord(1, "/a") + ChunkRecord(records, records.size(), 0, ""));
  EXPECT_TRUE(result.status.ok());
  EXPECT_EQ(result.messages.size(), 1U);
}

}  // namespace
}  // namespace shiftmap::mcap
