// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/mistake_probabilities.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <string>

#include "tests/support/random_map.h"

namespace shiftmap::testing {
namespace {

constexpr double kShift = 17'280.0;  // [s]

Stamp At(double seconds) { return StampFromSeconds(1.7e9 + seconds); }

// A fleet of five over landmarks that stand at mode 1 or 2; the first vehicle's visits are wrong.
struct Fleet {
  std::vector<LandmarkGroup> groups;
  std::vector<EvidenceRow> rows;
};

// @param moves  Probability that a landmark moves between two shifts.
Fleet DrawFleet(int days, double moves, bool lies) {
  std::mt19937_64 random(TestSeed(31));
  Fleet fleet;
  for (int g = 0; g < 12; ++g) {
    LandmarkGroup& group =
        fleet.groups.emplace_back(RandomGroup(random, fmt::format("{:02}", g), 2));
    group.chain = ModeChain::Uniform(2, std::max(1e-6, moves / kShift));
    int truth = 1;
    for (int shift = 0; shift < 5 * days; ++shift) {
      if (std::bernoulli_distribution(moves)(random)) truth = 3 - truth;
      const int said = lies && shift % 5 == 0 ? 3 - truth : truth;
      const double begin = shift * kShift + 10.0 * g;
      VisitEvidence visit{group.signature, At(begin), At(begin + 5.0), {}};
      for (int i = 0; i <= 2; ++i) {
        visit.modes.push_back({group.NumberOf(i), i == said ? 0.0 : -20.0});
      }
      fleet.rows.push_back(
          {std::to_string(shift), visit, fmt::format("vehicle-{}", shift % 5 + 1)});
    }
  }
  return fleet;
}

// Mean over the visits of one vehicle, or of all others.
double MeanOf(const Fleet& fleet, const std::vector<double>& values, bool of_first) {
  double sum = 0.0;
  double count = 0.0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if ((fleet.rows[i].vehicle == "vehicle-1") != of_first) continue;
    sum += values[i];
    ++count;
  }
  return sum / count;
}

TEST(MistakeProbabilitiesTest, AreHighOfAVehicleThatTheOthersContradict) {
  for (const double moves : {0.0, 0.01, 0.1}) {
    const Fleet fleet = DrawFleet(10, moves, true);
    const std::vector<double> mistaken = MistakeProbabilities(fleet.groups, fleet.rows);
    EXPECT_GT(MeanOf(fleet, mistaken, true), 0.85) << moves;
    EXPECT_LT(MeanOf(fleet, mistaken, false), 0.03) << moves;
  }
}

TEST(MistakeProbabilitiesTest, AreLowWhereAllAreHonest) {
  for (const double moves : {0.0, 0.01, 0.1}) {
    const Fleet fleet = DrawFleet(10, moves, false);
    const std::vector<double> mistaken = MistakeProbabilities(fleet.groups, fleet.rows);
    EXPECT_LT(MeanOf(fleet, mistaken, true), 0.01) << moves;
    EXPECT_LT(MeanOf(fleet, mistaken, false), 0.01) << moves;
  }
}

TEST(MistakeProbabilitiesTest, DoNotDependOnTheOrderOfRows) {
  Fleet fleet = DrawFleet(4, 0.05, true);
  const std::vector<double> expected = MistakeProbabilities(fleet.groups, fleet.rows);
  std::vector<std::size_t> order(fleet.rows.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::mt19937_64 random(TestSeed(32));
  std::shuffle(order.begin(), order.end(), random);
  std::vector<EvidenceRow> shuffled;
  for (const std::size_t i : order) shuffled.push_back(fleet.rows[i]);
  const std::vector<double> mistaken = MistakeProbabilities(fleet.groups, shuffled);
  for (std::size_t i = 0; i < order.size(); ++i) EXPECT_EQ(mistaken[i], expected[order[i]]);
}

TEST(MistakeProbabilitiesTest, OfLandmarksThatTheMapDoesNotHaveNothingIsSaid) {
  Fleet fleet = DrawFleet(2, 0.0, false);
  fleet.groups.erase(fleet.groups.begin());
  const std::vector<double> mistaken = MistakeProbabilities(fleet.groups, fleet.rows);
  for (std::size_t i = 0; i < mistaken.size(); ++i) {
    if (fleet.rows[i].evidence.signature.text() != "00") continue;
    EXPECT_EQ(mistaken[i], 0.0);
  }
}

}  // namespace
}  // namespace shiftmap::testing
