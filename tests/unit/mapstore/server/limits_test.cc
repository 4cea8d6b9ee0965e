// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/limits.h"

#include <gtest/gtest.h>

#include "mapstore/server/calls.h"
#include "tests/support/status_matchers.h"

namespace shiftmap::server {
namespace {

using shiftmap::testing::IsOk;
using shiftmap::testing::StatusIs;

TEST(RateLimitTest, AClientHasTwoSecondsAtOnceAndThenItsRate) {
  RateLimit limit(5.0);
  RateLimit::Clock::time_point now{};
  for (int i = 0; i < 10; ++i) EXPECT_THAT(limit.Take("a", now), IsOk());
  EXPECT_THAT(limit.Take("a", now), StatusIs(StatusCode::kResourceExhausted, "5 calls a second"));
  EXPECT_THAT(limit.Take("b", now), IsOk());
  now += std::chrono::milliseconds(200);
  EXPECT_THAT(limit.Take("a", now), IsOk());
  EXPECT_FALSE(limit.Take("a", now).ok());
  now += std::chrono::hours(1);
  for (int i = 0; i < 10; ++i) EXPECT_THAT(limit.Take("a", now), IsOk());
  EXPECT_FALSE(limit.Take("a", now).ok());
}

TEST(RateLimitTest, ForgettingSilentClientsForgivesNobody) {
  RateLimit limit(1.0);
  const RateLimit::Clock::time_point now{};
  for (int i = 0; i < 10'000; ++i) EXPECT_THAT(limit.Take(std::to_string(i), now), IsOk());
  EXPECT_THAT(limit.Take("7", now), IsOk());
  EXPECT_FALSE(limit.Take("7", now).ok());
}

TEST(SlotsTest, ASlotIsFreeAgainAtItsEnd) {
  Slots slots(3, 2);
  const auto a = slots.Take("a");
  {
    const auto b = slots.Take("a");
    EXPECT_THAT(b, IsOk());
    EXPECT_THAT(slots.Take("a"), StatusIs(StatusCode::kResourceExhausted, "2 streams of this"));
    const auto c = slots.Take("b");
    EXPECT_THAT(slots.Take("c"), StatusIs(StatusCode::kResourceExhausted, "3 streams are open"));
    EXPECT_EQ(slots.taken(), 3);
  }
  EXPECT_EQ(slots.taken(), 1);
  EXPECT_THAT(slots.Take("a"), IsOk());
}

TEST(CallsTest, AVehicleHandsInAndReadsWhatItDrivesOn) {
  const auto allowed = [](Role role) {
    std::string calls;
    for (int i = 0; i < kCalls; ++i) {
      const Call call = static_cast<Call>(i);
      if (MayCall(role, call)) calls += std::string(NameOf(call)) + " ";
    }
    return calls;
  };
  EXPECT_EQ(allowed(Role::kVehicle),
            "ListAreas GetSnapshot FetchSnapshot SubmitReport GetUpload UploadLog WatchSnapshots ");
  const std::string reads =
      "ListAreas ListVersions GetSnapshot FetchSnapshot GetModeProbabilities WatchSnapshots ";
  EXPECT_EQ(allowed(Role::kMapper), reads);
  EXPECT_EQ(allowed(Role::kInspector), reads);
  for (int i = 0; i < kCalls; ++i) EXPECT_TRUE(MayCall(Role::kOperator, static_cast<Call>(i)));
}

TEST(CallsTest, AVehicleActsForItselfAndAnOperatorForAll) {
  EXPECT_TRUE(MayActFor({"truck", Role::kVehicle, "", ""}, "truck"));
  EXPECT_FALSE(MayActFor({"truck", Role::kVehicle, "", ""}, "Truck"));
  EXPECT_FALSE(MayActFor({"truck", Role::kVehicle, "", ""}, ""));
  EXPECT_TRUE(MayActFor({"boss", Role::kOperator, "", ""}, "truck"));
}

}  // namespace
}  // namespace shiftmap::server
