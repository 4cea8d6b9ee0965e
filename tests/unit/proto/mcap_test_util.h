// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "proto/core/status.h"
#include "proto/mcap/writer.h"

namespace shiftmap::mcap {

/// A message as a test compares it.
struct TestMessage {
  std::string topic;
  std::uint32_t sequence = 0;
  std::uint64_t time_ns = 0;
  std::uint64_t publish_time_ns = 0;
  std::string data;
  friend bool operator==(const TestMessage&, const TestMessage&) = default;
};

/// What a reader made of a file.
struct ReadResult {
  std::vector<TestMessage> messages;  ///< Before the end or the error.
  Status status;
  std::string truncation;
};

ReadResult ReadAll(const std::string& bytes);

/// True if `part` is how `whole` begins.
bool IsPrefix(const std::vector<TestMessage>& part, const std::vector<TestMessage>& whole);

/// `count` messages on the topics /a and /b, of seeded random sizes below `max_bytes`.
std::vector<TestMessage> MakeMessages(int count, std::size_t max_bytes, unsigned seed);

/// The file that our writer makes of messages, which carry their channels' sequence numbers.
std::string WriteAll(const std::vector<TestMessage>& messages, const WriterOptions& options);

}  // namespace shiftmap::mcap
