// SPDX-License-Identifier: Apache-2.0
#include "localizer/filter/event_buffer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <utility>
#include <vector>

namespace shiftmap {
namespace {

constexpr double kDelay = 0.2;

OdometrySample Sample(double stamp_s, double v_mps = 0.0) {
  return {StampFromSeconds(stamp_s), v_mps, 0.0};
}

// All that is due, by stamp in seconds and velocity; of a scan -1, of a lidar's its range.
std::vector<std::pair<double, double>> Drain(EventBuffer* buffer) {
  struct Tag {
    double operator()(const OdometrySample& sample) const { return sample.v_mps; }
    double operator()(const LidarScan& scan) const { return static_cast<double>(scan.ranges_m[0]); }
    double operator()(const Scan&) const { return -1.0; }
  };
  std::vector<std::pair<double, double>> due;
  while (const HeldEvent* event = buffer->Next()) {
    due.emplace_back(ToSecondsSinceEpoch(event->stamp), event->Visit(Tag()));
  }
  return due;
}

// Arrival is at the stamp plus a delay within the bound; with gaps and equal stamps.
TEST(EventBuffer, WhatComesWithinTheBoundComesOutSorted) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> delay(0.0, 0.99 * kDelay);
    std::uniform_int_distribution<int> gap(0, 3);
    std::vector<std::pair<double, RunEvent>> arrivals;
    std::vector<std::pair<double, double>> expected;
    double stamp = 1000.0;
    for (int i = 0; i < 400; ++i) {
      stamp += i % 100 == 50 ? 30.0 : 0.02 * gap(random);
      const bool is_scan = i % 7 == 0;
      // Equal stamps arrive in one go, in the order in which they are expected.
      const bool same = !expected.empty() && expected.back().first == stamp;
      const double arrival = same ? arrivals.back().first : stamp + delay(random);
      RunEvent event = Sample(stamp, i);
      if (is_scan) event = Scan{StampFromSeconds(stamp), {}};
      if (i % 7 == 3) event = LidarScan{StampFromSeconds(stamp), {}, {static_cast<float>(i), 0.0f}};
      arrivals.emplace_back(arrival, event);
      expected.emplace_back(stamp, is_scan ? -1.0 : i);
    }
    std::stable_sort(arrivals.begin(), arrivals.end(), [](const auto& a, const auto& b) {
      return a.first < b.first;
    });
    EventBuffer buffer(FromSeconds(kDelay));
    std::vector<std::pair<double, double>> due;
    for (const auto& [arrival, event] : arrivals) {
      buffer.Add(event);
      for (const auto& item : Drain(&buffer)) due.push_back(item);
    }
    buffer.Flush();
    for (const auto& item : Drain(&buffer)) due.push_back(item);
    ASSERT_EQ(due.size(), expected.size()) << seed;
    for (std::size_t i = 0; i < due.size(); ++i) {
      EXPECT_NEAR(due[i].first, expected[i].first, 1e-6) << seed;
      EXPECT_EQ(due[i].second, expected[i].second) << seed;
    }
    EXPECT_EQ(buffer.jumps(), 0) << seed;
  }
}

TEST(EventBuffer, HoldsForTheDelayAndNoLonger) {
  EventBuffer buffer(FromSeconds(kDelay));
  for (int i = 0; i <= 20; ++i) buffer.Add(Sample(1000.0 + 0.01 * i));
  EXPECT_EQ(Drain(&buffer).size(), 1u);
  buffer.Flush();
  EXPECT_EQ(Drain(&buffer).size(), 20u);
  EXPECT_EQ(buffer.size(), 0u);
}

TEST(EventBuffer, IsBounded) {
  EventBuffer buffer(FromSeconds(60.0));
  for (std::size_t i = 0; i < 3 * EventBuffer::kMaxEvents; ++i) {
    buffer.Add(Sample(1000.0 + 1e-3 * static_cast<double>(i)));
    Drain(&buffer);
    EXPECT_LE(buffer.size(), EventBuffer::kMaxEvents);
  }
}

TEST(EventBuffer, IsBoundedInBeams) {
  EventBuffer buffer(FromSeconds(kDelay));
  const LidarScan scan{StampFromSeconds(1000.0), {}, std::vector(10'000, 1.0f)};
  for (int i = 0; i < 300; ++i) {
    buffer.Add(scan);
    Drain(&buffer);
    EXPECT_LE(buffer.size() * scan.ranges_m.size(), EventBuffer::kMaxBeams);
  }
}

TEST(EventBuffer, OneStampFarAheadIsDropped) {
  for (const int bad_at : {0, 5, 9}) {
    EventBuffer buffer(FromSeconds(kDelay));
    std::size_t due = 0;
    for (int i = 0; i < 10; ++i) {
      if (i == bad_at) buffer.Add(Sample(90000.0));
      buffer.Add(Sample(1000.0 + 0.1 * i));
      due += Drain(&buffer).size();
    }
    buffer.Flush();
    due += Drain(&buffer).size();
    EXPECT_EQ(due, 10u) << bad_at;
    EXPECT_EQ(buffer.jumps(), 1) << bad_at;
  }
}

TEST(EventBuffer, AGapIsNoJump) {
  EventBuffer buffer(FromSeconds(kDelay));
  buffer.Add(Sample(1000.0));
  buffer.Add(Sample(1000.1));
  buffer.Add(Sample(5000.0));
  EXPECT_EQ(Drain(&buffer).size(), 0u);
  buffer.Add(Sample(4999.9));
  EXPECT_EQ(Drain(&buffer).size(), 2u);
  buffer.Add(Sample(5001.5));
  buffer.Add(Sample(5003.5));
  EXPECT_EQ(Drain(&buffer).size(), 2u);
  EXPECT_EQ(buffer.jumps(), 0);
}

TEST(EventBuffer, APauseMakesAllDueAlsoWhatCameAfterAGap) {
  EventBuffer buffer(FromSeconds(kDelay));
  buffer.Add(Sample(1000.0));
  buffer.Add(Sample(1000.1));
  buffer.Add(Sample(1005.0));
  buffer.FlushPaused();
  EXPECT_EQ(Drain(&buffer).size(), 3u);
  buffer.Add(Sample(1010.0));
  buffer.FlushPaused();
  EXPECT_EQ(Drain(&buffer).size(), 1u);
  EXPECT_EQ(buffer.size(), 0u);
  EXPECT_EQ(buffer.jumps(), 0);
}

}  // namespace
}  // namespace shiftmap
