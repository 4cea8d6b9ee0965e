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

}  // namespace
}  // namespace shiftmap
