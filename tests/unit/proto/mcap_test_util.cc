// SPDX-License-Identifier: Apache-2.0
#include "tests/unit/proto/mcap_test_util.h"

#include <algorithm>
#include <map>
#include <random>
#include <sstream>

#include "proto/core/check.h"
#include "proto/mcap/reader.h"

namespace shiftmap::mcap {

ReadResult ReadAll(const std::string& bytes) {
  ReadResult result;
  std::istringstream in(bytes);
  auto reader = Reader::Open(&in);
  if (!reader.ok()) {
    result.status = reader.status();
    return result;
  }
  for (;;) {
    const auto message = reader->Next();
    if (!message.ok()) {
      result.status = message.status();
      break;
    }
    if (!*message) break;
    const LogMessage& got = **message;
    result.messages.push_back({.topic = got.channel->topic,
                               .sequence = got.sequence,
                               .time_ns = got.log_time_ns,
                               .publish_time_ns = got.publish_time_ns,
                               .data = std::string(got.data)});
  }
  result.truncation = reader->truncation();
  return result;
}

bool IsPrefix(const std::vector<TestMessage>& part, const std::vector<TestMessage>& whole) {
  return part.size() <= whole.size() && std::equal(part.begin(), part.end(), whole.begin());
}

std::vector<TestMessage> MakeMessages(int count, std::size_t max_bytes, unsigned seed) {
  std::mt19937 random(seed);
  std::map<std::string, std::uint32_t> sequence;
  std::vector<TestMessage> messages;
  for (int i = 0; i < count; ++i) {
    TestMessage message;
    message.topic = random() % 3 == 0 ? "/b" : "/a";
    message.sequence = sequence[message.topic]++;
    message.time_ns = 1'000'000'000ULL + static_cast<std::uint64_t>(i) * 10;
    message.publish_time_ns = message.time_ns;
    // Half random, so that compression has something to do and something to fail at.
    message.data.assign(random() % max_bytes, 'x');
    for (std::size_t k = 0; k < message.data.size(); k += 2) {
      message.data[k] = static_cast<char>(static_cast<unsigned char>(random()));
    }
    messages.push_back(std::move(message));
  }
  return messages;
}

std::string WriteAll(const std::vector<TestMessage>& messages, const WriterOptions& options) {
  std::string bytes;
  Writer writer(
      [&bytes](std::string_view more) {
        bytes.append(more);
        return OkStatus();
      },
      options);
  std::map<std::string, std::uint16_t> channels;
  for (const char* topic : {"/a", "/b"}) {
    const std::uint16_t schema = writer.AddSchema("test.Message", "protobuf", "schema of test");
    channels[topic] = writer.AddChannel(schema, topic, "protobuf");
  }
  for (const TestMessage& message : messages) {
    const Status status = writer.Write(channels.at(message.topic), message.time_ns, message.data);
    SHIFTMAP_CHECK(status.ok(), "{}", Message(status));
  }
  const Status status = writer.Finish();
  SHIFTMAP_CHECK(status.ok(), "{}", Message(status));
  return bytes;
}

}  // namespace shiftmap::mcap
