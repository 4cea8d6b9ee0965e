// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/clock.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>

namespace shiftmap {
namespace {

using ::testing::HasSubstr;

TEST(FormatUtc, IsTheCalendarDateOfAStamp) {
  EXPECT_EQ(FormatUtc(StampFromSeconds(1767945600.0)), "2026-01-09 08:00:00");
  EXPECT_EQ(FormatUtc(StampFromSeconds(-0.5)), "1969-12-31 23:59:59");
}

TEST(CheckNotInFuture, ToleratesAClockThatIsAheadByTheToleranceAndNoMore) {
  const Stamp now = StampFromSeconds(1767945600.0);
  EXPECT_TRUE(CheckNotInFuture("log", now + FromSeconds(600.0), now, 600.0).ok());
  const Status status = CheckNotInFuture("log", now + FromSeconds(601.0), now, 600.0);
  EXPECT_EQ(status.code(), StatusCode::kInvalidArgument);
  EXPECT_THAT(Message(status), HasSubstr("2026-01-09 08:10:01"));
  EXPECT_THAT(Message(status), HasSubstr("2026-01-09 08:00:00"));
}

TEST(CheckNotInFuture, TakesTheLargestStampsThereAre) {
  EXPECT_FALSE(CheckNotInFuture("log", Stamp::max(), Stamp::min(), 600.0).ok());
  EXPECT_TRUE(CheckNotInFuture("log", Stamp::min(), Stamp::max(), 600.0).ok());
}

TEST(CheckClockWasSet, RefusesWhatBeginsBeforeTheYear2000) {
  EXPECT_TRUE(CheckClockWasSet("log", StampFromSeconds(946684800.0)).ok());
  const Status status = CheckClockWasSet("log", StampFromSeconds(946684799.0));
  EXPECT_EQ(status.code(), StatusCode::kInvalidArgument);
  EXPECT_THAT(Message(status), HasSubstr("log: begins at 1999-12-31 23:59:59 UTC"));
}

}  // namespace
}  // namespace shiftmap
