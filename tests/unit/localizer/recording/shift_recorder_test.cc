// SPDX-License-Identifier: Apache-2.0
#include "localizer/recording/shift_recorder.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <utility>
#include <vector>

#include "mapstore/codec/run_log.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/localizer/simulated_run.h"

namespace shiftmap {
namespace {

using testing::IsOk;
using testing::StatusIs;

// A shift in which a landmark in five stands at its other mode, and in which somebody tells the
// localizer a wrong pose half-way.
class ShiftRecorderTest : public ::testing::Test {
 protected:
  void SetUp() override {
    MapContent content = MakeTwoModeMap(25, 12.0, 3);
    std::vector<Eigen::Matrix2d> diagonal;
    for (int i = 0; i < content.covariance.size(); ++i) {
      diagonal.push_back(content.covariance.Block(i, i));
    }
    content.covariance =
        JointCovariance(std::move(diagonal), {{0, 3, 1e-6 * Eigen::Matrix2d::Identity()}});
    std::vector<int> states(content.groups.size(), 1);
    for (std::size_t i = 0; i < states.size(); i += 5) states[i] = 2;
    SimulationOptions simulation;
    simulation.seed = 4;
    simulation.duration_s = 120.0;
    run_ = Simulate(content, PositionsOf(content, states), simulation).run;
    map_ = Snapshot(content);
    LocalizerOptions options;
    options.initial_pose =
        PoseWithCovariance{Se2(), Eigen::Vector3d(0.04, 0.04, 0.0025).asDiagonal()};
    localizer_.emplace(*map_, options);
  }

  // @param recorder  Null: drives without.
  void Drive(ShiftRecorder* recorder) {
    const std::vector<RunEvent> events = MergeEvents(run_);
    for (std::size_t i = 0; i < events.size(); ++i) {
      if (i == events.size() / 2) {
        localizer_->Initialize(
            {Se2(3.0, -2.0, 2.5), Eigen::Vector3d(0.01, 0.01, 0.001).asDiagonal()});
      }
      ASSERT_THAT(localizer_->Process(events[i]), IsOk());
      for (const StampedOutcome& outcome : localizer_->new_innovations()) {
        if (outcome.outcome.gated) nis_.push_back(outcome.outcome.nis);
      }
      if (recorder == nullptr) continue;
      ASSERT_THAT(recorder->Record(*localizer_), IsOk());
    }
  }

  void Record() {
    RecordedShift shift;
    shift.vehicle = "truck <b>é";
    shift.run_uuid = "7b7e7a3e-0000-4000-8000-000000000000";
    shift.software = "test 1";
    auto recorder = ShiftRecorder::Create(path_, shift, *map_, run_.odometry.front().stamp);
    ASSERT_THAT(recorder, IsOk());
    Drive(&*recorder);
    ASSERT_THAT(recorder->Finish(), IsOk());
  }

  shiftmap::Run run_;
  std::optional<MapSnapshot> map_;
  std::optional<Localizer> localizer_;
  std::vector<double> nis_;
  testing::TempDir folder_;
  std::string path_ = folder_.File("shift.mcap");
};

TEST_F(ShiftRecorderTest, ARecordingHoldsWhatTheLocalizerSaid) {
  Record();
  const auto recording = ReadShiftRecording(path_);
  ASSERT_THAT(recording, IsOk());
  EXPECT_EQ(recording->truncation, "");
  EXPECT_EQ(recording->shift.vehicle, "truck <b>é");
  EXPECT_EQ(recording->shift.content_hash, map_->content_hash());
  ASSERT_TRUE(recording->map);
  // All of the map but correlations, which a recording leaves out.
  EXPECT_TRUE(recording->map->covariance().cross_blocks().empty());
  MapContent whole = recording->map->content();
  whole.covariance = map_->covariance();
  EXPECT_EQ(ContentHash(whole), ContentHash(map_->content()));

  ASSERT_EQ(recording->states.size(), localizer_->state_changes().size());
  for (std::size_t i = 0; i < recording->states.size(); ++i) {
    const StateChange& said = localizer_->state_changes()[i];
    EXPECT_EQ(recording->states[i].stamp, said.stamp);
    EXPECT_EQ(recording->states[i].to, said.to);
    EXPECT_EQ(recording->states[i].evidence.support.failing, said.evidence.support.failing);
    EXPECT_EQ(recording->states[i].evidence.signature, said.evidence.signature);
  }
  const bool was_lost = std::any_of(
      recording->states.begin(), recording->states.end(), [](const StateChange& change) {
        return change.to == LocalizerState::kLost;
      });
  EXPECT_TRUE(was_lost);
}

TEST_F(ShiftRecorderTest, DecisionsLessThoseTakenBackAreThoseThatStand) {
  Record();
  const auto recording = ReadShiftRecording(path_);
  ASSERT_THAT(recording, IsOk());
  std::vector<Decision> standing;
  int withdrawn = 0;
  const auto same = [](const Decision& a, const Decision& b) {
    return a.signature == b.signature && a.mode == b.mode && a.stamp == b.stamp;
  };
  for (const DecisionChange& change : recording->decisions) {
    if (!change.withdrawn) {
      standing.push_back(change.decision);
      continue;
    }
    ++withdrawn;
    const auto found =
        std::find_if(standing.begin(), standing.end(), [&](const Decision& decision) {
          return same(decision, change.decision);
        });
    ASSERT_NE(found, standing.end());
    standing.erase(found);
  }
  EXPECT_GT(withdrawn, 0);
  ASSERT_EQ(standing.size(), localizer_->decisions().size());
  EXPECT_TRUE(
      std::is_permutation(standing.begin(), standing.end(), localizer_->decisions().begin(), same));
}

TEST_F(ShiftRecorderTest, EveryInnovationIsThereAndAgreesWithItsNis) {
  Record();
  const auto recording = ReadShiftRecording(path_);
  ASSERT_THAT(recording, IsOk());
  std::vector<double> recorded;
  for (const ScanInnovations& scan : recording->innovations) {
    EXPECT_GE(scan.quality, 0.0);
    EXPECT_LE(scan.quality, 1.0);
    for (const RecordedInnovation& innovation : scan.innovations) {
      if (innovation.mode == kAbsent) continue;
      recorded.push_back(innovation.nis);
      EXPECT_NEAR(innovation.nis,
                  innovation.nu.dot(innovation.S.inverse() * innovation.nu),
                  1e-9 * (1.0 + innovation.nis));
    }
  }
  EXPECT_EQ(recorded, nis_);
  EXPECT_GT(recorded.size(), 200U);
}

TEST_F(ShiftRecorderTest, RatesAreBounded) {
  Record();
  const auto recording = ReadShiftRecording(path_);
  ASSERT_THAT(recording, IsOk());
  ASSERT_GT(recording->poses.size(), 10U);
  for (std::size_t i = 1; i < recording->poses.size(); ++i) {
    EXPECT_GE(recording->poses[i].stamp - recording->poses[i - 1].stamp, FromSeconds(0.1));
  }
  ASSERT_GT(recording->hypotheses.size(), 10U);
  for (std::size_t i = 1; i < recording->hypotheses.size(); ++i) {
    EXPECT_GE(recording->hypotheses[i].stamp - recording->hypotheses[i - 1].stamp,
              FromSeconds(0.5));
  }
  for (const HypothesesSample& sample : recording->hypotheses) {
    EXPECT_TRUE(std::is_sorted(sample.leaf_weights.rbegin(), sample.leaf_weights.rend()));
  }
}

TEST_F(ShiftRecorderTest, ARecordedLocalizerSaysTheSameBits) {
  Record();
  const ShiftReport recorded = localizer_->Report();
  SetUp();
  Drive(nullptr);
  const ShiftReport plain = localizer_->Report();
  ASSERT_EQ(recorded.evidence.size(), plain.evidence.size());
  for (std::size_t i = 0; i < plain.evidence.size(); ++i) {
    for (std::size_t k = 0; k < plain.evidence[i].modes.size(); ++k) {
      EXPECT_EQ(recorded.evidence[i].modes[k].log_likelihood,
                plain.evidence[i].modes[k].log_likelihood);
    }
  }
}

TEST_F(ShiftRecorderTest, WhatIsNotFinishedLeavesNothing) {
  {
    auto recorder = ShiftRecorder::Create(path_, {}, *map_, run_.odometry.front().stamp);
    ASSERT_THAT(recorder, IsOk());
  }
  EXPECT_THAT(ReadShiftRecording(path_), StatusIs(StatusCode::kNotFound, path_));
  EXPECT_THAT(ShiftRecorder::Create(folder_.File("none/a.mcap"), {}, *map_, Stamp()),
              StatusIs(StatusCode::kNotFound, "recording '"));
}

// Every byte that changes is found by a checksum or refused by what reads it; none crashes.
TEST_F(ShiftRecorderTest, ARecordingTakesThePlaceOfNoRunLog) {
  ASSERT_THAT(WriteRunLog(run_, path_), IsOk());
  const std::string log = testing::ReadFile(path_);
  const auto again = [&] { return ShiftRecorder::Create(path_, {}, *map_, Stamp()).status(); };
  EXPECT_THAT(again(), StatusIs(StatusCode::kInvalidArgument, "a run log is there"));
  EXPECT_EQ(testing::ReadFile(path_), log);
  std::filesystem::remove(path_);
  Record();
  EXPECT_THAT(again(), IsOk());
}

TEST_F(ShiftRecorderTest, ADamagedRecordingIsAnErrorOrAShorterOne) {
  Record();
  std::ifstream in(path_, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(in), {}};
  const std::size_t states = ReadShiftRecording(path_)->states.size();
  std::mt19937_64 random(testing::TestSeed(8));
  const std::string damaged = folder_.File("damaged.mcap");
  int errors = 0;
  for (int i = 0; i < 60; ++i) {
    std::string other = bytes;
    if (i % 3 == 0) {
      other.resize(random() % bytes.size());
    } else {
      other[random() % bytes.size()] ^= static_cast<char>(1 + random() % 255);
    }
    testing::WriteFile(damaged, other);
    const auto recording = ReadShiftRecording(damaged);
    if (!recording.ok()) {
      ++errors;
      EXPECT_THAT(recording, StatusIs(recording.status().code(), "recording '"));
    } else {
      EXPECT_LE(recording->states.size(), states);
    }
  }
  EXPECT_GT(errors, 20);
  EXPECT_THAT(ReadShiftRecording(folder_.path()), StatusIs(StatusCode::kInvalidArgument, ""));
}

}  // namespace
}  // namespace shiftmap
