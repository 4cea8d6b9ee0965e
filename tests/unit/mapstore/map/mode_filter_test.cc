// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/mode_filter.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"

namespace shiftmap::testing {
namespace {

Stamp At(double seconds) { return StampFromSeconds(seconds); }

// The distribution at the state's own time.
Eigen::VectorXd Now(const LandmarkGroup& group, const ModeState& state) {
  return ProbabilitiesAt(group, state, state.stamp);
}

// The posterior of the state at the last visit by summing over all sequences of states, one per
// visit; visits must not overlap.
Eigen::VectorXd BruteForce(const LandmarkGroup& group,
                           Stamp stamp,
                           const std::vector<EvidenceRow>& rows) {
  const int states = group.chain.states();
  Eigen::VectorXd posterior = Eigen::VectorXd::Zero(states);
  const auto sequences = static_cast<int>(std::pow(states, rows.size() + 1));
  for (int sequence = 0; sequence < sequences; ++sequence) {
    int digits = sequence;
    int state = digits % states;
    double weight = group.probabilities(state);
    Stamp time = stamp;
    for (const EvidenceRow& row : rows) {
      digits /= states;
      const int next = digits % states;
      weight *= group.chain.Transition(row.evidence.begin - time)(state, next);
      weight *= std::exp(row.evidence.modes[static_cast<std::size_t>(next)].log_likelihood);
      time = row.evidence.end;
      state = next;
    }
    posterior(state) += weight;
  }
  return posterior / posterior.sum();
}

TEST(ModeFilterTest, EqualsTheSumOverAllModeSequences) {
  std::mt19937_64 random(TestSeed(11));
  for (int round = 0; round < 50; ++round) {
    const int modes = 1 + round % 3;
    LandmarkGroup group = RandomGroup(random, "A", modes);
    group.chain = ModeChain::Uniform(modes, 1e-3);
    std::vector<EvidenceRow> rows;
    double time = 0.0;
    for (int i = 0; i < 4; ++i) {
      const double begin = time + std::uniform_real_distribution<double>(0.0, 500.0)(random);
      time = begin + 30.0;
      rows.push_back({std::to_string(i), RandomEvidence(random, group, At(begin), At(time))});
    }
    const ModeState state = FilterModes(group, StartModes(group, At(0.0)), rows);
    EXPECT_EQ(state.stamp, At(time));
    EXPECT_THAT(Now(group, state), IsNearMatrix(BruteForce(group, At(0.0), rows), 1e-12));
  }
}

TEST(ModeFilterTest, WithoutRowsThePriorStays) {
  std::mt19937_64 random(TestSeed(12));
  const LandmarkGroup group = RandomGroup(random, "A", 3);
  const ModeState state = FilterModes(group, StartModes(group, At(5.0)), {});
  EXPECT_THAT(Now(group, state), IsNearMatrix(group.probabilities, 1e-15));
  EXPECT_EQ(state.stamp, At(5.0));
  EXPECT_FALSE(state.started);
}

TEST(ModeFilterTest, UnknownModesAreIgnoredAndUnnamedOnesGetTheValueForAbsent) {
  std::mt19937_64 random(TestSeed(13));
  const LandmarkGroup group = RandomGroup(random, "A", 2);
  Eigen::VectorXd values;
  EXPECT_TRUE(StateLogLikelihoods(
      group, {{kAbsent, -1.0}, {ModeNumber(2), 0.5}, {ModeNumber(9), 0.4}}, &values));
  EXPECT_EQ(values, Eigen::Vector3d(-1.0, -1.0, 0.5));
}

TEST(ModeFilterTest, EvidenceForAnUnknownModeIsNotCarriedOver) {
  std::mt19937_64 random(TestSeed(13));
  const LandmarkGroup group = RandomGroup(random, "A", 2);
  VisitEvidence evidence = RandomEvidence(random, group, At(0.0), At(1.0));
  evidence.modes = {{kAbsent, -1.0}, {ModeNumber(2), 0.5}, {ModeNumber(9), 50.0}};
  Eigen::VectorXd values;
  EXPECT_FALSE(StateLogLikelihoods(group, evidence.modes, &values));
  EXPECT_FALSE(FilterModes(group, StartModes(group, At(0.0)), {{"u", evidence}}).started);
}

TEST(ModeFilterTest, MergedModesSpeakForTheOneThatStandsForThem) {
  std::mt19937_64 random(TestSeed(13));
  LandmarkGroup group = RandomGroup(random, "A", 2);
  group.merged = {{ModeNumber(4), ModeNumber(1)}, {ModeNumber(7), ModeNumber(1)}};
  Eigen::VectorXd values;
  EXPECT_TRUE(StateLogLikelihoods(group,
                                  {{kAbsent, -9.0},
                                   {ModeNumber(1), -3.0},
                                   {ModeNumber(2), -5.0},
                                   {ModeNumber(4), 2.0},
                                   {ModeNumber(7), 1.0}},
                                  &values));
  EXPECT_EQ(values, Eigen::Vector3d(-9.0, 2.0, -5.0));
  EXPECT_EQ(group.NextNumber(), ModeNumber(8));
}

// Nothing else is known: the result is what is stated, whatever the chain.
TEST(ModeFilterTest, AStatementAloneIsWhatItSays) {
  std::mt19937_64 random(TestSeed(17));
  for (int round = 0; round < 20; ++round) {
    LandmarkGroup group = RandomGroup(random, "A", 1 + round % 4);
    if (round % 2 == 1) {
      const Eigen::Index states = group.chain.states();
      Eigen::MatrixXd rates = 1e-3 * (Eigen::MatrixXd::Random(states, states).array() + 1.5);
      rates.diagonal() -= rates.rowwise().sum();
      group.chain = *ModeChain::FromRates(rates);
    }
    ModeState state = StationaryStart(group, At(0.0));
    AddStatement(group, group.probabilities, At(50.0), &state);
    EXPECT_THAT(Now(group, state), IsNearMatrix(group.probabilities, 1e-12));
    EXPECT_EQ(state.stamp, At(50.0));
  }
}

// To state what the chain relaxes to is to say nothing.
TEST(ModeFilterTest, AStatementOfTheStationaryDistributionChangesNothing) {
  std::mt19937_64 random(TestSeed(18));
  LandmarkGroup group = RandomGroup(random, "A", 3);
  group.chain = ModeChain::Uniform(3, 1e-3);
  const ModeState stationary = StationaryStart(group, At(0.0));
  const ModeState visits =
      FilterModes(group, stationary, {{"u", RandomEvidence(random, group, At(0.0), At(90.0))}});
  ModeState state = visits;
  AddStatement(group, Now(group, stationary), At(200.0), &state);
  EXPECT_THAT(Now(group, state), IsNearMatrix(ProbabilitiesAt(group, visits, At(200.0)), 1e-12));
}

// Stated: mode 1 since shortly before. A day earlier a visit said mode 2. The newer stands.
TEST(ModeFilterTest, OlderVisitsDoNotOverruleAStatement) {
  std::mt19937_64 random(TestSeed(19));
  LandmarkGroup group = RandomGroup(random, "A", 2);
  group.chain = ModeChain::Uniform(2, 1e-5);
  VisitEvidence old = RandomEvidence(random, group, At(0.0), At(10.0));
  old.modes = {{kAbsent, -40.0}, {ModeNumber(1), -40.0}, {ModeNumber(2), 0.0}};
  ModeState state = FilterModes(group, StationaryStart(group, At(0.0)), {{"u", old}});
  AddStatement(group, Eigen::Vector3d(1e-9, 1.0 - 2e-9, 1e-9), At(86'400.0), &state);
  EXPECT_GT(Now(group, state)(1), 1.0 - 1e-7);
}

TEST(ModeFilterTest, StatedModesAreCarriedToTheModesOfNow) {
  std::mt19937_64 random(TestSeed(20));
  LandmarkGroup group = RandomGroup(random, "A", 2);
  group.modes[1].number = ModeNumber(5);
  group.merged = {{ModeNumber(2), ModeNumber(1)}};
  EXPECT_EQ(
      CarriedProbabilities(group, {{kAbsent, 0.1}, {ModeNumber(1), 0.3}, {ModeNumber(2), 0.4}}),
      Eigen::Vector3d(0.1, 0.7, 0.1));
}

TEST(ModeFilterTest, NoTimePassesInsideOverlappingVisits) {
  std::mt19937_64 random(TestSeed(14));
  const LandmarkGroup group = RandomGroup(random, "A", 2);
  const VisitEvidence outer = RandomEvidence(random, group, At(0.0), At(1e6));
  const VisitEvidence inner = RandomEvidence(random, group, At(10.0), At(20.0));
  const ModeState state =
      FilterModes(group, StartModes(group, At(0.0)), {{"u", outer}, {"v", inner}});
  Eigen::VectorXd expected = group.probabilities;
  for (Eigen::Index i = 0; i < expected.size(); ++i) {
    const auto mode = static_cast<std::size_t>(i);
    expected(i) *= std::exp(outer.modes[mode].log_likelihood + inner.modes[mode].log_likelihood);
  }
  EXPECT_THAT(Now(group, state), IsNearMatrix(expected / expected.sum(), 1e-13));
  EXPECT_EQ(state.stamp, At(1e6));
}

TEST(ModeFilterTest, ExtremeEvidenceOfOverlappingVisitsCancels) {
  std::mt19937_64 random(TestSeed(15));
  const LandmarkGroup group = RandomGroup(random, "A", 1);
  VisitEvidence against = RandomEvidence(random, group, At(0.0), At(9.0));
  against.modes = {{kAbsent, 0.0}, {ModeNumber(1), -1e5}};
  VisitEvidence in_favour = against;
  in_favour.modes = {{kAbsent, -1e5}, {ModeNumber(1), 0.0}};
  const ModeState state =
      FilterModes(group, StartModes(group, At(0.0)), {{"u", against}, {"v", in_favour}});
  EXPECT_THAT(Now(group, state), IsNearMatrix(group.probabilities, 1e-9));
}

TEST(ModeFilterTest, ImpossibleStateStaysImpossibleWithoutJumps) {
  std::mt19937_64 random(TestSeed(16));
  LandmarkGroup group = RandomGroup(random, "A", 1);
  group.chain = ModeChain::Uniform(1, 0.0);
  group.probabilities = Eigen::Vector2d(1.0, 0.0);
  VisitEvidence evidence = RandomEvidence(random, group, At(10.0), At(20.0));
  evidence.modes = {{kAbsent, -1e5}, {ModeNumber(1), 0.0}};
  EXPECT_EQ(Now(group, FilterModes(group, StartModes(group, At(0.0)), {{"u", evidence}})),
            group.probabilities);
}

// A ledger of an older version may hold them.
TEST(ModeFilterTest, StampsFartherApartThanADurationAreForEver) {
  std::mt19937_64 random(TestSeed(18));
  LandmarkGroup group = RandomGroup(random, "A", 2);
  group.chain = ModeChain::Uniform(2, 1e-6);
  ModeState state = StartModes(group, Stamp::min());
  state.started = true;
  AddVisit(group, Stamp::max(), Stamp::max(), Eigen::Vector3d::Zero(), &state);
  EXPECT_EQ(state.stamp, Stamp::max());
  const Eigen::Vector3d stationary = Eigen::Vector3d::Constant(1.0 / 3.0);
  EXPECT_THAT(Eigen::VectorXd(state.log_probabilities.array().exp()),
              IsNearMatrix(stationary, 1e-12));
  EXPECT_THAT(ProbabilitiesAt(group, StartModes(group, Stamp::min()), Stamp::max()),
              IsNearMatrix(stationary, 1e-12));
}

TEST(ModeFilterTest, PropagationGoesForwardOnly) {
  std::mt19937_64 random(TestSeed(17));
  const LandmarkGroup group = RandomGroup(random, "A", 2);
  const ModeState state = StartModes(group, At(100.0));
  EXPECT_THAT(ProbabilitiesAt(group, state, At(50.0)), IsNearMatrix(group.probabilities, 1e-15));
  const Eigen::VectorXd expected =
      group.chain.Transition(FromSeconds(900.0)).transpose() * group.probabilities;
  EXPECT_THAT(ProbabilitiesAt(group, state, At(1000.0)), IsNearMatrix(expected, 1e-14));
}

}  // namespace
}  // namespace shiftmap::testing
