// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/mine_world.h"

#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tools/sim/mine_files.h"
#include "tools/sim/world_files.h"

namespace shiftmap {
namespace {

using testing::IsOk;
using testing::StatusIs;

MineWorldOptions SmallMine() {
  MineWorldOptions options;
  options.seed = 5;
  options.plan.length_m = 70.0;
  options.plan.drawpoints = 4;
  options.plan.crosscuts = 1;
  options.landmarks.tags = 6;
  options.runs = 2;
  return options;
}

void Write(const MineWorldOptions& options, const std::string& directory) {
  const StatusOr<MineWorld> mine = SimulateMine(options);
  ASSERT_THAT(mine, IsOk());
  ASSERT_THAT(WriteWorld(mine->world, directory), IsOk());
  ASSERT_THAT(WriteMinePlan(mine->site, directory), IsOk());
}

TEST(MineWorld, TheSameSeedGivesTheSameBits) {
  const testing::TempDir dir;
  Write(SmallMine(), dir.File("a"));
  Write(SmallMine(), dir.File("b"));
  MineWorldOptions other = SmallMine();
  other.seed = 6;
  Write(other, dir.File("c"));
  for (const char* file : {"/run_000.mcap",
                           "/run_001.truth.tum",
                           "/run_001.places.csv",
                           "/truth.csv",
                           "/modes.csv",
                           "/plan.csv",
                           "/plan.svg"}) {
    EXPECT_EQ(testing::ReadFile(dir.File("a") + file), testing::ReadFile(dir.File("b") + file));
    EXPECT_NE(testing::ReadFile(dir.File("a") + file), testing::ReadFile(dir.File("c") + file));
  }
}

TEST(MineWorld, LandmarksMoveAndStayAwayAsOftenAsStated) {
  MineWorldOptions options = SmallMine();
  options.runs = 150;
  options.drive.max_duration_s = 0.1;
  options.mode_change_probability = 0.3;
  options.absent_probability = 0.1;
  options.landmarks.corners = true;
  options.versions = {PlanVersion::kOriginal, PlanVersion::kModified};
  const StatusOr<MineWorld> mine = SimulateMine(options);
  ASSERT_THAT(mine, IsOk());
  const std::size_t corners = mine->site.barriers.size();
  int moved = 0;
  int pairs = 0;
  int absent = 0;
  int all = 0;
  for (std::size_t r = 0; r < mine->world.runs.size(); ++r) {
    const std::vector<ModeNumber>& now = mine->world.runs[r].active_mode;
    for (std::size_t g = 0; g < now.size(); ++g) {
      if (g >= corners && g < corners + mine->site.corners) {
        EXPECT_EQ(now[g], ModeNumber(r == 0 ? 1 : 2));
        continue;
      }
      ++all;
      absent += now[g] == kAbsent;
      if (r == 0 || now[g] == kAbsent) continue;
      const ModeNumber before = mine->world.runs[r - 1].active_mode[g];
      if (before == kAbsent) continue;
      ++pairs;
      moved += before != now[g];
    }
  }
  EXPECT_NEAR(static_cast<double>(moved) / pairs, 0.3, 0.06);
  EXPECT_NEAR(static_cast<double>(absent) / all, 0.1, 0.04);
}

TEST(MineWorld, RunsFollowEachOther) {
  const StatusOr<MineWorld> mine = SimulateMine(SmallMine());
  ASSERT_THAT(mine, IsOk());
  const std::vector<SimulatedRun>& runs = mine->world.runs;
  ASSERT_EQ(runs.size(), 2U);
  EXPECT_EQ(ToSeconds(runs[1].truth.front().stamp - runs[0].truth.front().stamp), 86400.0);
  EXPECT_EQ(runs[0].run.info.vehicle, "vehicle-1");
  EXPECT_EQ(runs[1].run.info.vehicle, "vehicle-2");
  for (const SimulatedRun& run : runs) EXPECT_THAT(ValidateRun(run.run), IsOk());
}

TEST(MineWorld, RefusesOptionsOutOfRange) {
  MineWorldOptions options = SmallMine();
  options.runs = 0;
  EXPECT_THAT(SimulateMine(options), StatusIs(StatusCode::kInvalidArgument, "runs = 0"));
  options = SmallMine();
  options.versions.clear();
  EXPECT_THAT(SimulateMine(options), StatusIs(StatusCode::kInvalidArgument, "no version"));
  options = SmallMine();
  options.absent_probability = 2.0;
  EXPECT_THAT(SimulateMine(options), StatusIs(StatusCode::kInvalidArgument, "0..1"));
}

}  // namespace
}  // namespace shiftmap
