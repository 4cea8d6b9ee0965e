// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/track_recorder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "mapstore/map_store.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap {
namespace {

using testing::IsOk;
using ::testing::SizeIs;

// A version from one mapped run, and shifts of three vehicles that keep contradicting each other.
class Tracks : public ::testing::Test {
 protected:
  void Commit(bool states_probabilities) {
    content_ = testing::RandomContent(random_, {.groups = 5, .max_modes = 3});
    Eigen::MatrixXd rates = Eigen::MatrixXd::Constant(2, 2, 2e-4);
    rates << -3e-4, 3e-4, 1e-5, -1e-5;
    content_.groups[0].modes.resize(1);
    content_.groups[0].probabilities = Eigen::Vector2d(0.25, 0.75);
    content_.groups[0].chain = *ModeChain::FromRates(rates);
    std::vector<Eigen::Matrix2d> diagonal;
    for (const LandmarkGroup& group : content_.groups) {
      for (const Mode& mode : group.modes) diagonal.push_back(mode.cov_p_map_landmark);
    }
    content_.covariance = JointCovariance(std::move(diagonal), {});
    RunRecord run;
    run.name = "run_000";
    run.sha256 = std::string(64, 'a');
    run.vehicle = "truck-0";
    run.begin = content_.stamp - FromSeconds(1000.0);
    run.end = content_.stamp;
    for (int i = 0; i < 10 && !states_probabilities; ++i) {
      run.evidence.push_back(RandomVisit(run.begin + FromSeconds(90.0 * i)));
    }
    CommitOptions options;
    options.states_probabilities = states_probabilities;
    const auto result = store_.Commit("a", content_, {"test", "", 0, {run}}, options);
    ASSERT_THAT(result, IsOk());
    content_hash_ = result->content_hash;
    for (int shift = 0; shift < 12; ++shift) Return(shift);
  }

  VisitEvidence RandomVisit(Stamp begin) {
    const LandmarkGroup& group = content_.groups[random_() % content_.groups.size()];
    return testing::RandomEvidence(random_, group, begin, begin + FromSeconds(25.0));
  }

  void Return(int number) {
    ShiftReport report;
    report.uuid = fmt::format("00000000-0000-4000-8000-{:012}", number);
    report.vehicle = fmt::format("truck-{}", number % 3);
    report.area = "a";
    report.version = VersionNumber(1);
    report.content_hash = content_hash_;
    report.software = "test";
    report.begin = content_.stamp + FromSeconds(2000.0 * number);
    report.end = report.begin + FromSeconds(1500.0);
    for (int i = 0; i < 12; ++i) {
      report.evidence.push_back(RandomVisit(report.begin + FromSeconds(110.0 * i)));
    }
    ASSERT_THAT(store_.Return(report), IsOk());
  }

  // As the page does it.
  Eigen::VectorXd At(const LandmarkTracks& tracks, std::size_t group, Stamp at) const {
    const TrackPoint* last = &tracks.points[group].front();
    for (const TrackPoint& point : tracks.points[group]) {
      if (point.begin <= at) last = &point;
    }
    return content_.groups[group].chain.Propagate(last->probabilities, at - last->end);
  }

  void ExpectAsLoaded(const LandmarkTracks& tracks, Stamp from) {
    for (int i = 0; i < 200; ++i) {
      const double share = std::uniform_real_distribution<double>(0.0, 1.0)(random_);
      const Stamp at = from + FromSeconds(share * 40'000.0);
      const auto map = store_.LoadAt("a", std::nullopt, at);
      ASSERT_THAT(map, IsOk());
      for (std::size_t group = 0; group < content_.groups.size(); ++group) {
        const Eigen::VectorXd difference =
            At(tracks, group, at) - map->groups()[group].probabilities;
        EXPECT_LT(difference.cwiseAbs().maxCoeff(), 5e-4)
            << "group " << group << " at " << ToSecondsSinceEpoch(at);
      }
    }
  }

  std::mt19937_64 random_{testing::TestSeed(5)};
  testing::TempDir dir_;
  MapStore store_ = *MapStore::Open(dir_.File("a.db"), MapStore::Access::kReadWriteCreate);
  MapContent content_;
  std::string content_hash_;
};

TEST_F(Tracks, RunByTheChainAreTheProbabilitiesOfLoadAt) {
  ASSERT_NO_FATAL_FAILURE(Commit(false));
  const auto tracks = store_.LoadTracks("a");
  ASSERT_THAT(tracks, IsOk());
  EXPECT_GT(tracks->points[1].size(), 10U);
  ExpectAsLoaded(*tracks, content_.stamp);
}

TEST_F(Tracks, HoldWhatAVersionStates) {
  ASSERT_NO_FATAL_FAILURE(Commit(true));
  const auto tracks = store_.LoadTracks("a");
  ASSERT_THAT(tracks, IsOk());
  ExpectAsLoaded(*tracks, content_.stamp);
}

TEST_F(Tracks, OfABoundedNumberOfVisitsAreRightFromThereOn) {
  ASSERT_NO_FATAL_FAILURE(Commit(false));
  const auto tracks = store_.LoadTracks("a", {.max_visits = 40});
  ASSERT_THAT(tracks, IsOk());
  EXPECT_GT(tracks->since, content_.stamp);
  std::size_t visits = 0;
  for (const auto& of_group : tracks->visits) visits += of_group.size();
  EXPECT_EQ(visits, 40U);
  ExpectAsLoaded(*tracks, tracks->since);
}

TEST_F(Tracks, VisitsAreThoseOfTheSingleLandmark) {
  ASSERT_NO_FATAL_FAILURE(Commit(false));
  const auto tracks = store_.LoadTracks("a");
  ASSERT_THAT(tracks, IsOk());
  for (std::size_t group = 0; group < content_.groups.size(); ++group) {
    const auto records = store_.LoadLandmark("a", content_.groups[group].signature);
    ASSERT_THAT(records, IsOk());
    const std::vector<LandmarkVisit>& visits = tracks->visits[group];
    ASSERT_THAT(visits, SizeIs(records->visits.size()));
    for (std::size_t i = 0; i < visits.size(); ++i) {
      EXPECT_EQ(visits[i].evidence.begin, records->visits[i].evidence.begin);
      EXPECT_EQ(visits[i].run, records->visits[i].run);
      EXPECT_EQ(visits[i].set_aside, records->visits[i].set_aside);
      EXPECT_EQ(visits[i].probabilities, records->visits[i].probabilities);
    }
  }
}

}  // namespace
}  // namespace shiftmap
