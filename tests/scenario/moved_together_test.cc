// SPDX-License-Identifier: Apache-2.0
//
// Sparse sites where several landmarks stand displaced as one: where nothing else is in view, a
// vehicle whose wheels slipped would see the same. More of them, recorded: shiftmap-experiment
// localizer-bodies.
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "mapstore/codec/run_log.h"
#include "tests/scenario/world.h"
#include "tools/experiment/localizer_bodies.h"

namespace shiftmap {
namespace {

// Sites of 40 m with 30 landmarks, one shift each.
class Sites {
 public:
  explicit Sites(int sites) {
    for (int site = 0; site < sites; ++site) {
      const testing::World world({"--seed",
                                  std::to_string(site + 1),
                                  "--shifts",
                                  "1",
                                  "--groups",
                                  "30",
                                  "--modes",
                                  "1",
                                  "--size-m",
                                  "40"});
      TrueShift& shift = recordings_.shifts.emplace_back();
      shift.layout = site;
      shift.run = ReadRunLog(world.Log(0)).value().run;
      shift.truth = ReadTum(world.Truth(0)).value();
      Layout& layout = recordings_.layouts.emplace_back();
      for (const std::vector<std::string>& row : testing::ReadCsv(world.Places())) {
        layout[Signature(row[0])] = {std::stod(row[2]), std::stod(row[3])};
      }
    }
  }

  DisplacedTally Tally(DisplacedPart part, double displaced_m, int draws) const {
    std::uint64_t seed = 1;
    const auto runs =
        DrawDisplacedRuns(recordings_, part, displaced_m, draws, DisplacedOptions(), &seed);
    return TallyDisplaced(runs, Calibration(), DisplacedOptions(), 2).value();
  }

 private:
  UtiasRecordings recordings_;
};

TEST(MovedTogether, NeitherPullThePoseAlongNorAreTakenForAMode) {
  constexpr int kSites = 4;
  constexpr int kDraws = 6;
  const Sites sites(kSites);
  const DisplacedTally in_place = sites.Tally(DisplacedPart::kNothing, 0.0, 1);
  EXPECT_EQ(in_place.sure, 0);
  EXPECT_EQ(in_place.wrong_decisions, 0);

  DisplacedTally bodies;
  for (const double displaced_m : {0.7, 1.5, 3.0}) {
    bodies.Add(sites.Tally(DisplacedPart::kRack, displaced_m, kDraws));
    bodies.Add(sites.Tally(DisplacedPart::kSide, displaced_m, kDraws));
  }
  ASSERT_EQ(bodies.runs, 6 * kSites * kDraws);
  const auto poses = static_cast<double>(bodies.poses);
  // A filter that knows only moves of landmarks each by itself: 0.09, 0.07 and 30.
  EXPECT_LT(static_cast<double>(bodies.sure) / poses, 0.04);
  EXPECT_LT(static_cast<double>(bodies.wrong_decisions),
            0.03 * static_cast<double>(bodies.decisions));
  EXPECT_LT(bodies.nees_sum / poses, 12.0);
  RecordProperty("sure_share", std::to_string(static_cast<double>(bodies.sure) / poses));
  RecordProperty("nees", std::to_string(bodies.nees_sum / poses));
}

}  // namespace
}  // namespace shiftmap
