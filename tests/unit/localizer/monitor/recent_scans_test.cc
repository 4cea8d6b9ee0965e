// SPDX-License-Identifier: Apache-2.0
#include "localizer/monitor/recent_scans.h"

#include <gtest/gtest.h>

namespace shiftmap {
namespace {

TEST(RecentScans, KeepsTheLastSixtyFourInOrder) {
  RecentScans recent;
  for (int i = 0; i < 100; ++i) {
    WindowScan step;
    step.scan.stamp = StampFromSeconds(i);
    recent.Add(step);
  }
  const std::vector<WindowScan> all = recent.Since(Stamp());
  ASSERT_EQ(all.size(), 64u);
  EXPECT_EQ(all.front().scan.stamp, StampFromSeconds(36));
  EXPECT_EQ(all.back().scan.stamp, StampFromSeconds(99));
  EXPECT_EQ(recent.Since(StampFromSeconds(97)).size(), 3u);
  recent.Clear();
  EXPECT_TRUE(recent.Since(Stamp()).empty());
}

// Of a vehicle that drives and then stands, the way is kept and where it stands once.
TEST(RecentScans, OfAWayAreApart) {
  RecentScans way(RecentScans::Spacing{0.5, 0.1, 0.05});
  Se2 whole;
  for (int i = 0; i < 400; ++i) {
    WindowScan step;
    step.scan.stamp = StampFromSeconds(0.1 * i);
    if (i > 0) step.motion.elapsed_s = 0.1;
    if (i > 0 && i < 100) step.motion.increment.T_begin_end = Se2(0.03, 0.0, 0.01);
    whole = whole * step.motion.increment.T_begin_end;
    way.Add(step);
  }
  const std::vector<WindowScan> all = way.Since(Stamp::min());
  EXPECT_EQ(all.size(), 22u);
  EXPECT_EQ(all.back().scan.stamp, StampFromSeconds(39.9));
  Se2 by_motions;
  double elapsed_s = 0.0;
  for (const WindowScan& scan : all) {
    by_motions = by_motions * scan.motion.increment.T_begin_end;
    elapsed_s += scan.motion.elapsed_s;
  }
  EXPECT_LT((whole.Inverse() * by_motions).Log().norm(), 1e-12);
  EXPECT_NEAR(elapsed_s, 39.9, 1e-9);
}

}  // namespace
}  // namespace shiftmap
