// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/decimal.h"

#include <gtest/gtest.h>

#include <random>

namespace shiftmap {
namespace {

TEST(ParseStamp, IsExact) {
  const auto ns = [](std::string_view text) { return ToNanoseconds(ParseStamp(text).value()); };
  EXPECT_EQ(ns("0"), 0);
  EXPECT_EQ(ns("1."), 1'000'000'000);
  EXPECT_EQ(ns("1248272272.841"), 1'248'272'272'841'000'000);
  // A double holds this to some 100 ns only.
  EXPECT_EQ(ns("1248272272.123456789"), 1'248'272'272'123'456'789);
  EXPECT_EQ(ns("1248272272.12345678900"), 1'248'272'272'123'456'789);
  EXPECT_EQ(ns("7000000000.999999999"), 7'000'000'000'999'999'999);
}

TEST(ParseStamp, RoundTripsEveryNanosecondCount) {
  std::mt19937_64 random(50);
  for (int i = 0; i < 10'000; ++i) {
    const auto stamp_ns = static_cast<std::int64_t>(random() % 7'000'000'000'000'000'000);
    const std::string text =
        fmt::format("{}.{:09}", stamp_ns / 1'000'000'000, stamp_ns % 1'000'000'000);
    EXPECT_EQ(ToNanoseconds(ParseStamp(text).value()), stamp_ns) << text;
  }
}

TEST(ParseStamp, RejectsWhatIsNoStamp) {
  for (const std::string_view text : {"",
                                      ".",
                                      ".5",
                                      "-1",
                                      "+1",
                                      "1e9",
                                      "1.2.3",
                                      "1 ",
                                      "12a",
                                      "1.0000000001",
                                      "7000000001",
                                      "99999999999999999999"}) {
    EXPECT_EQ(ParseStamp(text).status().code(), StatusCode::kInvalidArgument) << text;
  }
}

TEST(ParseNumber, TakesFiniteNumbersOnly) {
  EXPECT_EQ(ParseNumber("-0.25").value(), -0.25);
  EXPECT_EQ(ParseNumber("1e-3").value(), 1e-3);
  for (const std::string_view text : {"", "nan", "inf", "1e999", "0x10", "1,5", "1.0m"}) {
    EXPECT_EQ(ParseNumber(text).status().code(), StatusCode::kInvalidArgument) << text;
  }
}

TEST(ParseInteger, TakesTheWholeText) {
  EXPECT_EQ(ParseInteger("-12").value(), -12);
  for (const std::string_view text : {"", "1.0", "12x", "9223372036854775808"}) {
    EXPECT_EQ(ParseInteger(text).status().code(), StatusCode::kInvalidArgument) << text;
  }
}

}  // namespace
}  // namespace shiftmap
