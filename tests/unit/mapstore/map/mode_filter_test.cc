// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/mode_filter.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <random>
#include <string>

#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"

namespace shiftmap::testing {
namespace {

Stamp At(double seconds) { return StampFromSeconds(seconds); }

// The distribution at the state's own time.
Eigen::VectorXd Now(const LandmarkGroup& group, const ModeState& state) {
  return ProbabilitiesAt(group, state, state.stamp);
}

// A chain that is not uniform; it leaves a state after some hundred seconds.
ModeChain RandomChain(std::mt19937_64& random, int modes) {
  std::uniform_real_distribution<double> rate(1e-3, 1e-2);
  Eigen::MatrixXd rates(modes + 1, modes + 1);
  for (double& value : rates.reshaped()) value = rate(random);
  rates.diagonal().setZero();
  rates.diagonal() = -rates.rowwise().sum();
  return *ModeChain::FromRates(rates);
}

// Σ over all sequences of states, one per visit, of their probability times the visits' likelihood,
// by the last state. Visits must not overlap.
Eigen::VectorXd SumOverSequences(const LandmarkGroup& group,
                                 const Eigen::VectorXd& start,
                                 Stamp stamp,
                                 const std::vector<EvidenceRow>& rows,
                                 const std::vector<bool>& counts) {
  const int states = group.chain.states();
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(states);
  const auto sequences = static_cast<int>(std::pow(states, rows.size() + 1));
  for (int sequence = 0; sequence < sequences; ++sequence) {
    int digits = sequence;
    int state = digits % states;
    double weight = start(state);
    Stamp time = stamp;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      digits /= states;
      const int next = digits % states;
      const VisitEvidence& visit = rows[i].evidence;
      weight *= group.chain.Transition(visit.begin - time)(state, next);
      if (counts[i]) weight *= std::exp(visit.modes[static_cast<std::size_t>(next)].log_likelihood);
      time = visit.end;
      state = next;
    }
    sum(state) += weight;
  }
  return sum;
}

struct BruteForcePosterior {
  Eigen::VectorXd states;        // At the last visit.
  std::vector<double> mistaken;  // Per turn.
};

// By summing over all sequences of states, and over all sets of turns that are mistakes.
BruteForcePosterior BruteForce(const LandmarkGroup& group,
                               Stamp stamp,
                               const std::vector<EvidenceRow>& rows) {
  std::vector<std::size_t> turn_of(rows.size());
  for (std::size_t i = 1; i < rows.size(); ++i) {
    turn_of[i] = turn_of[i - 1] + (rows[i].vehicle == rows[i - 1].vehicle ? 0 : 1);
  }
  const std::size_t turns = turn_of.back() + 1;
  BruteForcePosterior posterior{Eigen::VectorXd::Zero(group.chain.states()),
                                std::vector<double>(turns)};
  for (unsigned mistakes = 0; mistakes < (1U << turns); ++mistakes) {
    std::vector<bool> right(rows.size());
    for (std::size_t i = 0; i < rows.size(); ++i) right[i] = (mistakes >> turn_of[i] & 1U) == 0;
    double weight = 1.0;
    for (std::size_t turn = 0; turn < turns; ++turn) {
      std::vector<EvidenceRow> own;
      for (std::size_t i = 0; i < rows.size(); ++i) {
        if (turn_of[i] == turn) own.push_back(rows[i]);
      }
      const bool is_right = (mistakes >> turn & 1U) == 0;
      weight *= is_right
                    ? 1.0 - kMistakeProbability
                    : kMistakeProbability * SumOverSequences(group,
                                                             group.chain.stationary(),
                                                             own.front().evidence.begin,
                                                             own,
                                                             std::vector<bool>(own.size(), true))
                                                .sum();
    }
    const Eigen::VectorXd states =
        weight * SumOverSequences(group, group.probabilities, stamp, rows, right);
    posterior.states += states;
    for (std::size_t turn = 0; turn < turns; ++turn) {
      if ((mistakes >> turn & 1U) != 0) posterior.mistaken[turn] += states.sum();
    }
  }
  for (double& mistaken : posterior.mistaken) mistaken /= posterior.states.sum();
  posterior.states /= posterior.states.sum();
  return posterior;
}

TEST(ModeFilterTest, EqualsTheSumOverAllModeSequencesAndMistakes) {
  const std::array<std::string, 3> kVehicles = {"a", "b", "c"};
  std::mt19937_64 random(TestSeed(11));
  for (int round = 0; round < 50; ++round) {
    const int modes = 1 + round % 3;
    LandmarkGroup group = RandomGroup(random, "A", modes);
    group.chain = round % 3 == 0 ? RandomChain(random, modes) : ModeChain::Uniform(modes, 1e-3);
    std::vector<EvidenceRow> rows;
    double time = 0.0;
    for (int i = 0; i < 4; ++i) {
      const double begin = time + std::uniform_real_distribution<double>(0.0, 500.0)(random);
      time = begin + 30.0;
      rows.push_back({std::to_string(i),
                      RandomEvidence(random, group, At(begin), At(time)),
                      round % 2 == 0 ? kVehicles[random() % 2] : kVehicles[i % 3]});
    }
    const ModeState state = FilterModes(group, StartModes(group, At(0.0)), rows);
    EXPECT_EQ(state.stamp, At(time));
    EXPECT_THAT(Now(group, state), IsNearMatrix(BruteForce(group, At(0.0), rows).states, 1e-12));
  }
}

// What the first visit of another vehicle says of the turn before it.
TEST(ModeFilterTest, VerdictsAreThePosteriorOfMistakes) {
  std::mt19937_64 random(TestSeed(12));
  int verdicts = 0;
  for (int round = 0; round < 50; ++round) {
    const int modes = 1 + round % 3;
    LandmarkGroup group = RandomGroup(random, "A", modes);
    group.chain = round % 3 == 0 ? RandomChain(random, modes) : ModeChain::Uniform(modes, 1e-4);
    ModeState state = StartModes(group, At(0.0));
    std::vector<EvidenceRow> rows;
    Eigen::VectorXd log_likelihoods;
    for (int i = 0; i < 4; ++i) {
      const double begin = 600.0 * i + std::uniform_real_distribution<double>(0.0, 500.0)(random);
      rows.push_back({std::to_string(i),
                      RandomEvidence(random, group, At(begin), At(begin + 30.0)),
                      random() % 2 == 0 ? "a" : "b"});
      StateLogLikelihoods(group, rows.back().evidence.modes, &log_likelihoods);
      const std::optional<TurnVerdict> verdict = AddVisit(group,
                                                          At(begin),
                                                          At(begin + 30.0),
                                                          VehicleKey(rows.back().vehicle),
                                                          VehicleRecords(),
                                                          log_likelihoods,
                                                          &state);
      const bool ends_turn = i > 0 && rows[rows.size() - 2].vehicle != rows.back().vehicle;
      ASSERT_EQ(verdict.has_value(), ends_turn);
      if (!ends_turn) continue;
      ++verdicts;
      const std::vector<double> expected = BruteForce(group, At(0.0), rows).mistaken;
      EXPECT_NEAR(verdict->mistaken, expected[expected.size() - 2], 1e-12);
      EXPECT_EQ(verdict->vehicle, VehicleKey(rows[rows.size() - 2].vehicle));
    }
  }
  EXPECT_GT(verdicts, 30);
}

LandmarkGroup GroupOfTwo(double leave_rate_per_s) {
  std::mt19937_64 random(TestSeed(21));
  LandmarkGroup group = RandomGroup(random, "A", 2);
  group.chain = ModeChain::Uniform(2, leave_rate_per_s);
  return group;
}

// A visit that leaves no doubt that the landmark is at mode 1 or 2.
EvidenceRow Claim(const std::string& vehicle, int mode, double begin_s) {
  VisitEvidence visit{Signature("A"), At(begin_s), At(begin_s + 10.0), {}};
  for (int i = 0; i <= 2; ++i) visit.modes.push_back({ModeNumber(i), i == mode ? 0.0 : -50.0});
  return {vehicle + std::to_string(begin_s), visit, vehicle};
}

// All that one vehicle says is one case of right or wrong, also where the landmark moves: the two
// filters, mixed.
TEST(ModeFilterTest, AloneAVehicleIsBelievedButForTheMistake) {
  const LandmarkGroup group = GroupOfTwo(1e-5);
  Eigen::VectorXd p = Eigen::Vector3d::Constant(1.0 / 3.0);
  ModeState state = StationaryStart(group, At(0.0));
  double time = 0.0;
  for (const int mode : {1, 1, 2, 2, 1, 0, 2}) {
    p = group.chain.Propagate(p, FromSeconds(time == 0.0 ? 0.0 : 28'790.0));
    for (int i = 0; i <= 2; ++i) p(i) *= i == mode ? 1.0 : std::exp(-50.0);
    p /= p.sum();
    state = FilterModes(group, state, {Claim("loader", mode, time)});
    time += 28'800.0;
    const Eigen::VectorXd expected =
        ((1.0 - kMistakeProbability) * p).array() + kMistakeProbability / 3.0;
    EXPECT_THAT(Now(group, state), IsNearMatrix(expected, 1e-12));
    EXPECT_GT(Now(group, state)(mode), 0.999);
  }
}

// A hundred reports of one vehicle weigh as one, whatever lies between them.
TEST(ModeFilterTest, ManyVisitsOfAVehicleAreOneWord) {
  for (const double rate : {0.0, 1e-9, 1e-5}) {
    const LandmarkGroup group = GroupOfTwo(rate);
    const auto after = [&](int lies) {
      std::vector<EvidenceRow> rows{Claim("a", 1, 0.0), Claim("b", 1, 100.0), Claim("c", 1, 200.0)};
      for (int i = 0; i < lies; ++i) rows.push_back(Claim("liar", 2, 1000.0 + 20.0 * i));
      return Now(group, FilterModes(group, StationaryStart(group, At(0.0)), rows));
    };
    const double bound = 3.0 / kMistakeProbability;
    const double none = after(0)(2) / after(0)(1);
    const double one = after(1)(2) / after(1)(1);
    const double many = after(100)(2) / after(100)(1);
    EXPECT_LE(one, none * bound + rate * 2000.0 * bound);
    EXPECT_LE(many, 1.0001 * (one + rate * 3000.0 * bound));
  }
}

// One of five lies every night, last before it is looked at or in the midst of the others; the
// landmark moves once. After one honest visit the likeliest state is right, after two beyond doubt.
TEST(ModeFilterTest, OneHonestVisitMendsALie) {
  for (const double rate : {1e-9, 1e-7, 1e-6, 1e-5, 1e-4}) {
    for (int slot = 0; slot < 5; ++slot) {
      const LandmarkGroup group = GroupOfTwo(rate);
      ModeState state = StationaryStart(group, At(0.0));
      for (int night = 0; night < 10; ++night) {
        const int truth = night < 6 ? 1 : 2;
        int honest = 0;
        for (int shift = 0; shift < 5; ++shift) {
          const double begin = night * 86'400.0 + shift * 14'400.0;
          const bool lies = shift == slot;
          const int said = lies ? 3 - truth : truth;
          const std::string vehicle = "vehicle " + std::to_string(shift);
          state = FilterModes(group, state, {Claim(vehicle, said, begin)});
          honest = lies ? 0 : honest + 1;
          const double p = Now(group, state)(truth);
          // A landmark that never moves has moved all the same: one vehicle cannot say that alone.
          const bool believable = night != 6 || rate > 1e-8;
          if (honest == 1 && believable) {
            EXPECT_GT(p, 0.5) << rate << ", night " << night << ", " << slot << " lies, " << shift;
          }
          if (honest >= 2 && believable) {
            EXPECT_GT(p, 0.95) << rate << ", night " << night << ", " << slot << " lies, " << shift;
          }
        }
      }
    }
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
    AddStatement(group, group.probabilities, At(50.0), {}, &state);
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
  AddStatement(group, Now(group, stationary), At(200.0), {}, &state);
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
  AddStatement(group, Eigen::Vector3d(1e-9, 1.0 - 2e-9, 1e-9), At(86'400.0), {}, &state);
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
  Eigen::VectorXd likelihoods(group.chain.states());
  for (Eigen::Index i = 0; i < likelihoods.size(); ++i) {
    const auto mode = static_cast<std::size_t>(i);
    likelihoods(i) = std::exp(outer.modes[mode].log_likelihood + inner.modes[mode].log_likelihood);
  }
  const Eigen::VectorXd expected =
      (1.0 - kMistakeProbability) * group.probabilities.cwiseProduct(likelihoods) +
      kMistakeProbability * likelihoods.mean() * group.probabilities;
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
  AddVisit(group, Stamp::max(), Stamp::max(), 0, VehicleRecords(), Eigen::Vector3d::Zero(), &state);
  EXPECT_EQ(state.stamp, Stamp::max());
  const Eigen::Vector3d stationary = Eigen::Vector3d::Constant(1.0 / 3.0);
  EXPECT_THAT(state.Probabilities({}), IsNearMatrix(stationary, 1e-12));
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
