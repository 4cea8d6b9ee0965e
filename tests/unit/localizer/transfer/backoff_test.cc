// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/backoff.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <thread>
#include <vector>

namespace shiftmap::transfer {
namespace {

const Status kTemporary = Unavailable("busy");

TEST(BackoffTest, DelaysAreUniformBelowABoundThatDoublesUpToTheLongest) {
  constexpr int kTries = 8;
  constexpr int kFleet = 2000;
  const BackoffOptions options{.first_s = 0.5, .longest_s = 20.0, .give_up_s = 1e9};
  std::vector<std::vector<double>> delays(kTries);
  for (int vehicle = 0; vehicle < kFleet; ++vehicle) {
    Backoff backoff(options, static_cast<std::uint64_t>(vehicle));
    for (std::vector<double>& of_try : delays) of_try.push_back(backoff.NextDelayS());
  }
  double bound_s = options.first_s;
  for (const std::vector<double>& of_try : delays) {
    double sum_s = 0.0;
    for (const double delay_s : of_try) {
      EXPECT_GE(delay_s, 0.0);
      EXPECT_LE(delay_s, bound_s);
      sum_s += delay_s;
    }
    // A uniform one has this mean; its standard deviation over the fleet is 0.65 % of the bound.
    EXPECT_NEAR(sum_s / kFleet, bound_s / 2.0, 0.03 * bound_s);
    EXPECT_GT(*std::max_element(of_try.begin(), of_try.end()), 0.98 * bound_s);
    EXPECT_LT(*std::min_element(of_try.begin(), of_try.end()), 0.02 * bound_s);
    bound_s = std::min(options.longest_s, 2.0 * bound_s);
  }
}

TEST(BackoffTest, ProgressBringsTheFirstDelayBack) {
  Backoff backoff({.first_s = 0.1, .longest_s = 100.0, .give_up_s = 1e9}, 3);
  for (int i = 0; i < 12; ++i) backoff.NextDelayS();
  backoff.Progress();
  EXPECT_LE(backoff.NextDelayS(), 0.1);
}

TEST(BackoffTest, OnlyWhatTheServiceCallsTemporaryIsTriedAgain) {
  for (const StatusCode code :
       {StatusCode::kUnavailable, StatusCode::kResourceExhausted, StatusCode::kDeadlineExceeded}) {
    Backoff backoff({.first_s = 1e-6, .longest_s = 1e-6, .give_up_s = 1e9}, 1);
    EXPECT_TRUE(backoff.Again(Status(code, "x"), {})) << static_cast<int>(code);
    EXPECT_EQ(backoff.retries(), 1);
  }
  for (const StatusCode code : {StatusCode::kInvalidArgument,
                                StatusCode::kNotFound,
                                StatusCode::kPermissionDenied,
                                StatusCode::kUnauthenticated,
                                StatusCode::kOutOfRange,
                                StatusCode::kDataLoss,
                                StatusCode::kAborted,
                                StatusCode::kInternal,
                                StatusCode::kCancelled}) {
    Backoff backoff({.first_s = 1e-6, .longest_s = 1e-6, .give_up_s = 1e9}, 1);
    EXPECT_FALSE(backoff.Again(Status(code, "x"), {})) << static_cast<int>(code);
  }
}

TEST(BackoffTest, GivesUpAfterTheTimeWithoutProgress) {
  Backoff backoff({.first_s = 0.02, .longest_s = 0.02, .give_up_s = 0.1}, 5);
  int tries = 0;
  while (backoff.Again(kTemporary, {})) ASSERT_LT(++tries, 10'000);
  EXPECT_GE(tries, 3);
}

TEST(BackoffTest, AStopEndsTheWait) {
  std::stop_source stop;
  Backoff backoff({.first_s = 1e6, .longest_s = 1e6, .give_up_s = 1e9}, 5);
  std::jthread stopper([&] { stop.request_stop(); });
  EXPECT_FALSE(backoff.Again(kTemporary, stop.get_token()));
}

}  // namespace
}  // namespace shiftmap::transfer
