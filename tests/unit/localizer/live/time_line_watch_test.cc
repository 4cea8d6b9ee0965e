// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/time_line_watch.h"

#include <gtest/gtest.h>

namespace shiftmap::live {
namespace {

TimeLineWatch::Clock::time_point At(double seconds) {
  return TimeLineWatch::Clock::time_point() + FromSeconds(seconds);
}

class TimeLineWatchTest : public ::testing::Test {
 protected:
  TimeLineWatchTest() { watch_.Accepted(At(0.0)); }

  // The verdict after such an item every 0.1 s.
  TimeLine After(TimeLine why, double begin_s, double end_s) {
    for (double now_s = begin_s; now_s <= end_s; now_s += 0.1) watch_.Refused(why, At(now_s));
    return watch_.verdict();
  }

  TimeLineWatch watch_{std::chrono::seconds(1)};
};

TEST_F(TimeLineWatchTest, OnlyRefusedItemsForASecondAreAClockThatWasSet) {
  EXPECT_EQ(After(TimeLine::kLate, 5.0, 5.95), TimeLine::kAgrees);
  EXPECT_EQ(After(TimeLine::kLate, 6.0, 6.15), TimeLine::kLate);
  EXPECT_EQ(watch_.SinceAccepted(At(6.0)), std::chrono::seconds(6));
  watch_.Accepted(At(7.0));
  EXPECT_EQ(watch_.verdict(), TimeLine::kAgrees);
  EXPECT_EQ(After(TimeLine::kFuture, 8.0, 9.15), TimeLine::kFuture);
}

TEST_F(TimeLineWatchTest, OneThatFitsStartsTheSecondAnew) {
  for (int i = 0; i < 10; ++i) {
    EXPECT_EQ(After(TimeLine::kLate, 5.0 + i, 5.85 + i), TimeLine::kAgrees);
    watch_.Accepted(At(5.9 + i));
  }
}

TEST_F(TimeLineWatchTest, OneBadStampIsNoEvidenceHoweverLongThePause) {
  for (const TimeLine why : {TimeLine::kLate, TimeLine::kFuture}) {
    watch_.Refused(why, At(1.0));
    EXPECT_EQ(watch_.verdict(), TimeLine::kAgrees);
    watch_.Accepted(At(100.0));
    EXPECT_EQ(watch_.verdict(), TimeLine::kAgrees);
  }
  TimeLineWatch impatient{Duration::zero()};
  impatient.Refused(TimeLine::kLate, At(1.0));
  EXPECT_EQ(impatient.verdict(), TimeLine::kAgrees);
}

TEST_F(TimeLineWatchTest, AMixtureIsNotLateUntilOnlyLateItemsCome) {
  for (double now_s = 1.0; now_s < 5.0; now_s += 0.2) {
    watch_.Refused(TimeLine::kLate, At(now_s));
    watch_.Refused(TimeLine::kFuture, At(now_s + 0.1));
  }
  EXPECT_EQ(watch_.verdict(), TimeLine::kFuture);
  EXPECT_EQ(After(TimeLine::kLate, 5.0, 6.15), TimeLine::kLate);
}

}  // namespace
}  // namespace shiftmap::live
