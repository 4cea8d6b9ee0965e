// SPDX-License-Identifier: Apache-2.0
//
// Laws of the mode chain and of the filter over the evidence ledger.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "mapstore/map/mode_chain.h"
#include "mapstore/map/mode_filter.h"
#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"

namespace shiftmap::testing {
namespace {

// The distribution at the state's own time.
Eigen::VectorXd Now(const LandmarkGroup& group, const ModeState& state) {
  return ProbabilitiesAt(group, state, state.stamp);
}

class ModeLawTest : public ::testing::Test {
 protected:
  std::mt19937_64 random_{TestSeed(111)};

  double Uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }

  int Modes() { return std::uniform_int_distribution<int>(1, 5)(random_); }

  // Visits that overlap as those of several vehicles do, some at the same time.
  std::vector<EvidenceRow> Rows(const LandmarkGroup& group, int count) {
    std::vector<EvidenceRow> rows;
    for (int i = 0; i < count; ++i) {
      const Stamp begin = StampFromSeconds(std::floor(Uniform(0.0, 8.0)) * 1000.0);
      const Stamp end = begin + FromSeconds(std::floor(Uniform(0.0, 3.0)) * 900.0);
      const std::string vehicle = "vehicle " + std::to_string(i % 3);
      rows.push_back(
          {"report " + std::to_string(i), RandomEvidence(random_, group, begin, end), vehicle});
    }
    return rows;
  }
};

TEST_F(ModeLawTest, ChainIsASemigroup) {
  for (int i = 0; i < 500; ++i) {
    const ModeChain chain = ModeChain::Uniform(Modes(), Uniform(0.0, 1e-2));
    const Duration first = FromSeconds(Uniform(0.0, 1e3));
    const Duration second = FromSeconds(Uniform(0.0, 1e3));
    EXPECT_THAT(
        chain.Transition(first + second),
        IsNearMatrix(Eigen::MatrixXd(chain.Transition(first) * chain.Transition(second)), 1e-12));
  }
}

TEST_F(ModeLawTest, TransitionIsStochasticAndKeepsTheUniformDistribution) {
  for (int i = 0; i < 500; ++i) {
    const ModeChain chain = ModeChain::Uniform(Modes(), Uniform(0.0, 1.0));
    const Eigen::MatrixXd transition = chain.Transition(FromSeconds(Uniform(0.0, 1e4)));
    EXPECT_GE(transition.minCoeff(), 0.0);
    const Eigen::VectorXd ones = Eigen::VectorXd::Ones(chain.states());
    EXPECT_THAT(transition.rowwise().sum(), IsNearMatrix(ones, 1e-12));
    EXPECT_THAT(transition.colwise().sum().transpose(), IsNearMatrix(ones, 1e-12));
  }
}

TEST_F(ModeLawTest, FilterIsInvariantUnderPermutation) {
  for (int i = 0; i < 200; ++i) {
    const LandmarkGroup group = RandomGroup(random_, "A", Modes());
    std::vector<EvidenceRow> rows = Rows(group, 12);
    const ModeState expected = FilterModes(group, StartModes(group, StampFromSeconds(0.0)), rows);
    std::shuffle(rows.begin(), rows.end(), random_);
    const ModeState shuffled = FilterModes(group, StartModes(group, StampFromSeconds(0.0)), rows);
    EXPECT_EQ(Now(group, shuffled), Now(group, expected));
    EXPECT_EQ(shuffled.stamp, expected.stamp);
    EXPECT_NEAR(Now(group, expected).sum(), 1.0, 1e-12);
  }
}

TEST_F(ModeLawTest, DuplicatesCountOnce) {
  for (int i = 0; i < 200; ++i) {
    const LandmarkGroup group = RandomGroup(random_, "A", Modes());
    std::vector<EvidenceRow> rows = Rows(group, 6);
    const ModeState expected = FilterModes(group, StartModes(group, StampFromSeconds(0.0)), rows);
    const std::vector<EvidenceRow> copies = rows;
    rows.insert(rows.end(), copies.begin(), copies.end());
    std::shuffle(rows.begin(), rows.end(), random_);
    EXPECT_EQ(Now(group, FilterModes(group, StartModes(group, StampFromSeconds(0.0)), rows)),
              Now(group, expected));
  }
}

TEST_F(ModeLawTest, ConstantsCommonToAVisitCancel) {
  for (int i = 0; i < 200; ++i) {
    const LandmarkGroup group = RandomGroup(random_, "A", Modes());
    std::vector<EvidenceRow> rows = Rows(group, 6);
    const ModeState expected = FilterModes(group, StartModes(group, StampFromSeconds(0.0)), rows);
    for (EvidenceRow& row : rows) {
      const double constant = Uniform(-1e3, 1e3);
      for (auto& mode : row.evidence.modes) mode.log_likelihood += constant;
    }
    EXPECT_THAT(Now(group, FilterModes(group, StartModes(group, StampFromSeconds(0.0)), rows)),
                IsNearMatrix(Now(group, expected), 1e-11));
  }
}

TEST_F(ModeLawTest, FilteringInTwoStagesIsFilteringOnce) {
  for (int i = 0; i < 200; ++i) {
    const LandmarkGroup group = RandomGroup(random_, "A", Modes());
    std::vector<EvidenceRow> rows = Rows(group, 10);
    const ModeState expected = FilterModes(group, StartModes(group, StampFromSeconds(0.0)), rows);
    rows = InOrder(std::move(rows));
    const auto middle = rows.begin() + 5;
    const ModeState checkpoint =
        FilterModes(group, StartModes(group, StampFromSeconds(0.0)), {rows.begin(), middle});
    EXPECT_EQ(FilterModes(group, checkpoint, {middle, rows.end()}).Probabilities({}),
              expected.Probabilities({}));
  }
}

}  // namespace
}  // namespace shiftmap::testing
