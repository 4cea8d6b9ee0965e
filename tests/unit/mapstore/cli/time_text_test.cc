// SPDX-License-Identifier: Apache-2.0
#include "mapstore/cli/time_text.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <utility>

#include "mapstore/core/clock.h"
#include "tests/support/status_matchers.h"

namespace shiftmap {
namespace {

using testing::StatusIs;

// 2026-01-09 15:30:20.5 UTC.
const Stamp kNow = StampFromNanoseconds(1'767'972'620'500'000'000);

TEST(ParseTime, ReadsEveryFormThatItNames) {
  const std::pair<const char*, const char*> cases[] = {
      {"1767945900.5", "2026-01-09 08:05:00"},
      {"0", "1970-01-01 00:00:00"},
      {"2026-01-09", "2026-01-09 00:00:00"},
      {"2024-02-29", "2024-02-29 00:00:00"},
      {"2026-01-09T06:00Z", "2026-01-09 06:00:00"},
      {"2026-01-09T06:00", "2026-01-09 06:00:00"},
      {"2026-01-09 06:00:59", "2026-01-09 06:00:59"},
      {"2026-01-09T06:00:30+01:00", "2026-01-09 05:00:30"},
      {"2026-01-09T22:00-0330", "2026-01-10 01:30:00"},
      {"-8h", "2026-01-09 07:30:20"},
      {"-3d", "2026-01-06 15:30:20"},
      {"-90min", "2026-01-09 14:00:20"},
      {"-1.5m", "2026-01-09 15:28:50"},
      {"-20s", "2026-01-09 15:30:00"},
      {"-2w", "2025-12-26 15:30:20"},
      {"now", "2026-01-09 15:30:20"},
      {"today", "2026-01-09 00:00:00"},
      {"yesterday", "2026-01-08 00:00:00"},
  };
  for (const auto& [text, expected] : cases) {
    const StatusOr<Stamp> time = ParseTime(text, kNow);
    ASSERT_TRUE(time.ok()) << text;
    EXPECT_EQ(FormatUtc(*time), expected) << text;
  }
  EXPECT_EQ(*ParseTime("now", kNow), kNow);
  const Duration quarter =
      *ParseTime("2026-01-09T00:00:00.25Z", kNow) - *ParseTime("2026-01-09", kNow);
  EXPECT_NEAR(ToSeconds(quarter), 0.25, 1e-6);
}

TEST(ParseTime, RefusesEverythingElseAndNamesTheForms) {
  for (const char* text : {"",
                           "noon",
                           "2026-13-01",
                           "2026-02-29",
                           "2026-1-9",
                           "2026-01-09T",
                           "2026-01-09T25:00",
                           "2026-01-09T06:60",
                           "-8",
                           "-8y",
                           "--8h",
                           "8h",
                           "nan",
                           "1e300",
                           "2026-01-09T06:00X",
                           "2026-01-09T06:00:60",
                           "-100000d",
                           "2026-01-09T06:00:30+01:00Z",
                           "-h"}) {
    EXPECT_THAT(ParseTime(text, kNow),
                StatusIs(StatusCode::kInvalidArgument, "2026-01-09T06:00Z, "))
        << text;
  }
}

}  // namespace
}  // namespace shiftmap
