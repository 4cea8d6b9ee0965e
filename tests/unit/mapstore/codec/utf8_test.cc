// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "mapstore/core/utf8.h"
#include "proto/run_log.pb.h"

namespace shiftmap {
namespace {

TEST(Utf8, KnowsWellFormedText) {
  for (const std::string_view text : {"", "18", "é", "€", "\xf0\x9f\x9a\x9a", "\xf4\x8f\xbf\xbf"}) {
    EXPECT_TRUE(IsUtf8(text)) << text;
  }
}

TEST(Utf8, KnowsIllFormedText) {
  for (const std::string_view text : {"\x80",              // Continuation without a lead.
                                      "\xc3",              // Lead without a continuation.
                                      "\xc3(",             // Not a continuation.
                                      "\xc0\x80",          // Overlong.
                                      "\xe0\x80\x80",      // Overlong.
                                      "\xed\xa0\x80",      // Surrogate.
                                      "\xf4\x90\x80\x80",  // Above U+10FFFF.
                                      "\xff"}) {
    EXPECT_FALSE(IsUtf8(text));
  }
}

// Protobuf's own parser, which decides whether a reader takes a message, is the oracle.
TEST(Utf8, AgreesWithProtobufOnAllTwoAndManyThreeByteTexts) {
  testing::internal::CaptureStderr();  // Protobuf logs every rejection.
  int checked = 0;
  for (unsigned code = 0; code < 0x10000; code += 3, ++checked) {
    for (const char* tail : {"", "\x80", "\xbf"}) {
      const std::string text =
          std::string{static_cast<char>(code >> 8), static_cast<char>(code & 0xff)} + tail;
      // Field 1, vehicle, by hand: the setter would log.
      const std::string wire = std::string("\x0a") + static_cast<char>(text.size()) + text;
      proto::RunInfo message;
      ASSERT_EQ(IsUtf8(text), message.ParseFromString(wire)) << code;
    }
  }
  testing::internal::GetCapturedStderr();
  EXPECT_GT(checked, 20'000);
}

}  // namespace
}  // namespace shiftmap
