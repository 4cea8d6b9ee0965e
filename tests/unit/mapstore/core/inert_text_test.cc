// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/inert_text.h"

#include <gtest/gtest.h>

#include <random>

#include "mapstore/core/utf8.h"
#include "tests/support/random_map.h"

namespace shiftmap {
namespace {

TEST(InertText, WhatIsHarmlessStays) {
  for (const char* text : {"", "L07", "vehicle 1, µ-map: 100 % \\n", "Förderband 日本 🚜"}) {
    EXPECT_EQ(InertLine(text), text);
    EXPECT_EQ(InertText(text), text);
  }
}

TEST(InertText, WhatATerminalObeysIsEscaped) {
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"\x1b[2Kx", "\\x1b[2Kx"},
      {"a\ab\b", "a\\x07b\\x08"},
      {"a\nb\rc\td", "a\\nb\\rc\\td"},
      {std::string("a\0b", 3), "a\\x00b"},
      {"a\x7f", "a\\u007f"},
      {"a\xc2\x9b"
       "31m",
       "a\\u009b31m"},
      {"\xc2\x85", "\\u0085"},
      {"\xe2\x80\xae"
       "txt",
       "\\u202etxt"},
      {"\xe2\x81\xa6", "\\u2066"},
      {"\xe2\x80\xa8", "\\u2028"},
      {"\x9b"
       "31m",
       "\\x9b31m"},
      {"\xff\xfe", "\\xff\\xfe"},
      {"\xc3", "\\xc3"},
      {"\xe2\x80", "\\xe2\\x80"},
      {"\xc0\x8a", "\\xc0\\x8a"},
  };
  for (const auto& [text, expected] : cases) EXPECT_EQ(InertLine(text), expected);
}

TEST(InertText, TextKeepsItsLines) { EXPECT_EQ(InertText("a\r\nb\x1b\n"), "a\\r\nb\\x1b\n"); }

TEST(InertText, AnyBytesBecomeOneLineOfUtf8AndNothingMoreTheSecondTime) {
  std::mt19937_64 random(testing::TestSeed(5));
  for (int round = 0; round < 2000; ++round) {
    std::string text(random() % 40, '\0');
    for (char& c : text) c = static_cast<char>(random());
    const std::string line = InertLine(text);
    ASSERT_TRUE(IsUtf8(line));
    for (const char c : line) ASSERT_FALSE(static_cast<unsigned char>(c) < 0x20 || c == 0x7f);
    ASSERT_EQ(InertLine(line), line);
    ASSERT_EQ(InertText(InertText(text)), InertText(text));
  }
}

}  // namespace
}  // namespace shiftmap
