// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <unistd.h>

#include <ext/stdio_filebuf.h>
#include <sstream>
#include <thread>

#include "proto/mcap/reader.h"
#include "tests/unit/proto/mcap_test_util.h"

namespace shiftmap::mcap {
namespace {

constexpr unsigned kSeed = 20;

class McapRoundTrip : public testing::TestWithParam<WriterOptions> {};

TEST_P(McapRoundTrip, GivesTheMessagesInTheirOrder) {
  for (const int count : {0, 1, 2, 50, 3000}) {
    const auto messages = MakeMessages(count, 300, kSeed);
    const ReadResult result = ReadAll(WriteAll(messages, GetParam()));
    ASSERT_TRUE(result.status.ok()) << Message(result.status);
    EXPECT_EQ(result.truncation, "");
    EXPECT_EQ(result.messages, messages);
  }
}

TEST_P(McapRoundTrip, KeepsMessagesLargerThanAChunk) {
  const auto messages = MakeMessages(5, 3'000'000, kSeed);
  const ReadResult result = ReadAll(WriteAll(messages, GetParam()));
  ASSERT_TRUE(result.status.ok()) << Message(result.status);
  EXPECT_EQ(result.messages, messages);
}

TEST_P(McapRoundTrip, IsDeterministic) {
  const auto messages = MakeMessages(200, 300, kSeed);
  EXPECT_EQ(WriteAll(messages, GetParam()), WriteAll(messages, GetParam()));
}

INSTANTIATE_TEST_SUITE_P(Options,
                         McapRoundTrip,
                         testing::Values(WriterOptions{Compression::kNone, 0},
                                         WriterOptions{Compression::kNone, 1},
                                         WriterOptions{Compression::kNone, 1000},
                                         WriterOptions{Compression::kNone, 1 << 20},
                                         WriterOptions{Compression::kZstd, 1},
                                         WriterOptions{Compression::kZstd, 1000},
                                         WriterOptions{Compression::kZstd, 1 << 20}),
                         [](const auto& param_info) {
                           return std::string(param_info.param.compression == Compression::kZstd
                                                  ? "Zstd"
                                                  : "None") +
                                  std::to_string(param_info.param.chunk_bytes);
                         });

TEST(McapReader, TellsWhatAChannelIs) {
  const auto messages = MakeMessages(1, 10, kSeed);
  std::istringstream in(WriteAll(messages, {}));
  auto reader = Reader::Open(&in);
  ASSERT_TRUE(reader.ok());
  const auto message = reader->Next();
  ASSERT_TRUE(message.ok() && message->has_value());
  EXPECT_EQ((*message)->channel->message_encoding, "protobuf");
  EXPECT_EQ((*message)->channel->schema_name, "test.Message");
  EXPECT_EQ((*message)->channel->schema_encoding, "protobuf");
}

TEST(McapReader, StaysAtTheEnd) {
  std::istringstream in(WriteAll({}, {}));
  auto reader = Reader::Open(&in);
  ASSERT_TRUE(reader.ok());
  for (int i = 0; i < 3; ++i) {
    const auto message = reader->Next();
    ASSERT_TRUE(message.ok());
    EXPECT_FALSE(message->has_value());
  }
}

TEST(McapReader, ReadsAPipe) {
  const auto messages = MakeMessages(2000, 300, kSeed);
  const std::string bytes = WriteAll(messages, {Compression::kZstd, 10'000});
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  std::thread feeder([&] {
    for (std::size_t at = 0; at < bytes.size(); at += 777) {
      const std::string_view part = std::string_view(bytes).substr(at, 777);
      ASSERT_EQ(write(ends[1], part.data(), part.size()), static_cast<ssize_t>(part.size()));
    }
    close(ends[1]);
  });
  __gnu_cxx::stdio_filebuf<char> buffer(ends[0], std::ios::in | std::ios::binary);
  std::istream in(&buffer);
  auto reader = Reader::Open(&in);
  ASSERT_TRUE(reader.ok());
  std::size_t count = 0;
  for (;;) {
    const auto message = reader->Next();
    ASSERT_TRUE(message.ok()) << Message(message.status());
    if (!message->has_value()) break;
    ASSERT_LT(count, messages.size());
    EXPECT_EQ((*message)->data, messages[count].data);
    ++count;
  }
  feeder.join();
  EXPECT_EQ(count, messages.size());
  EXPECT_EQ(reader->truncation(), "");
}

TEST(McapWriter, ReportsWhatItsSinkReports) {
  int calls = 0;
  Writer writer(
      [&calls](std::string_view) { return ++calls < 4 ? OkStatus() : Unavailable("full"); },
      {Compression::kNone, 1});
  const std::uint16_t schema = writer.AddSchema("s", "protobuf", "");
  const std::uint16_t channel = writer.AddChannel(schema, "/a", "protobuf");
  EXPECT_TRUE(writer.Write(channel, 1, "stays in the chunk").ok());
  EXPECT_EQ(writer.Write(channel, 2, "closes it").code(), StatusCode::kUnavailable);
  EXPECT_EQ(writer.Finish().code(), StatusCode::kUnavailable);
}

}  // namespace
}  // namespace shiftmap::mcap
