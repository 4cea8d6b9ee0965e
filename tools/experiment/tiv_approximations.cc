// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/tiv_approximations.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "mapper/parallel.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// A mode is the landmark's true place, or is where it was, if it is nearer than the least shift.
// [m]
constexpr double kSamePlace = 0.75;

// The place of a state in the likeliest leaf; nothing if that has not found it.
std::optional<Eigen::Vector2d> PlaceOf(const TreeSlam& slam, int group, int state) {
  const SlamMap& map = slam.best().filter;
  const int landmark = map.mode(group, state).landmark;
  if (landmark == SlamMap::kNoLandmark) return std::nullopt;
  return map.state().Position(landmark);
}

bool IsTrueState(const TivLandmark& truth, int state) {
  return truth.true_state <= truth.modes ? state == truth.true_state : state > truth.modes;
}

bool IsRight(const TivLandmark& truth, int state, const std::optional<Eigen::Vector2d>& place) {
  return state > 0 && IsTrueState(truth, state) && place &&
         (*place - truth.place).norm() < kSamePlace;
}

// Follows the decisions about each landmark.
class DecisionWatch {
 public:
  explicit DecisionWatch(const ApproximationsDrive& drive)
      : drive_(drive), seen_(drive.landmarks.size(), -1), decided_(drive.landmarks.size(), false) {}

  void Look(int scan) {
    const Se2 T_vehicle_map = drive_.T_map_vehicle[static_cast<std::size_t>(scan)].Inverse();
    for (const Observation& observation :
         drive_.scans[static_cast<std::size_t>(scan)].observations) {
      const std::size_t g = GroupOf(observation.signature);
      const Eigen::Vector2d q = T_vehicle_map * drive_.landmarks[g].place;
      const bool true_sighting = (q - observation.PositionInVehicle()).norm() < kSamePlace;
      if (seen_[g] < 0 && true_sighting) seen_[g] = scan;
    }
  }

  void Take(const TreeSlam& slam,
            const std::vector<TreeDecision>& decisions,
            int scan,
            TivOutcome* outcome) {
    for (const TreeDecision& decision : decisions) {
      const std::size_t g = GroupOf(decision.decision.signature);
      const TivLandmark& truth = drive_.landmarks[g];
      const int state = slam.groups()[g].StateOf(decision.decision.mode);
      const auto place = state > 0 ? PlaceOf(slam, static_cast<int>(g), state) : std::nullopt;
      if (!IsRight(truth, state, place)) {
        ++outcome->wrong_decisions;
      } else if (!decided_[g] && truth.fate != LandmarkFate::kStays && seen_[g] >= 0) {
        outcome->scans_to_right.push_back(scan - seen_[g] + 1);
        decided_[g] = true;
      }
    }
  }

 private:
  std::size_t GroupOf(const Signature& signature) const {
    const auto found = std::find_if(
        drive_.map.groups.begin(), drive_.map.groups.end(), [&](const LandmarkGroup& group) {
          return group.signature == signature;
        });
    return static_cast<std::size_t>(found - drive_.map.groups.begin());
  }

  const ApproximationsDrive& drive_;
  std::vector<int> seen_;  // Scan of the first sighting that is no false alarm.
  std::vector<bool> decided_;
};

// The true mode is the likeliest, and the prior map's are where they were.
bool EndsRight(const LandmarkGroup& before, const LandmarkGroup& after, const TivLandmark& truth) {
  Eigen::Index state = 0;
  after.probabilities.maxCoeff(&state);
  if (state == 0) return false;
  const Eigen::Vector2d& place = after.modes[static_cast<std::size_t>(state) - 1].p_map_landmark;
  if (!IsRight(truth, static_cast<int>(state), place)) return false;
  for (std::size_t k = 0; k < before.modes.size(); ++k) {
    const Eigen::Vector2d moved = after.modes[k].p_map_landmark - before.modes[k].p_map_landmark;
    if (moved.norm() >= kSamePlace) return false;
  }
  return true;
}

void JudgeMap(const ApproximationsDrive& drive, const MapContent& end, TivOutcome* outcome) {
  outcome->all_right = true;
  for (std::size_t g = 0; g < drive.landmarks.size(); ++g) {
    const TivLandmark& truth = drive.landmarks[g];
    const bool right = EndsRight(drive.map.groups[g], end.groups[g], truth);
    outcome->all_right = outcome->all_right && right;
    const int expected = std::max(truth.modes, truth.true_state);
    outcome->spurious_modes += std::max(0, static_cast<int>(end.groups[g].modes.size()) - expected);
    if (truth.fate == LandmarkFate::kStays) continue;
    ++outcome->moved;
    outcome->moved_right += right ? 1 : 0;
  }
}

template <class Value>
SampleMean MeanOver(const std::vector<TivOutcome>& outcomes, const Value& value) {
  std::vector<double> values;
  for (const TivOutcome& outcome : outcomes) values.push_back(value(outcome));
  return MeanOf(values);
}

double Average(const std::vector<double>& values) {
  double sum = 0.0;
  for (const double value : values) sum += value;
  return sum / static_cast<double>(values.size());
}

// The root of a mean, and its error by the delta method.
SampleMean RootOf(const SampleMean& square) {
  const double root = std::sqrt(square.mean);
  return {root, square.standard_error / (2.0 * root)};
}

double RmseOf(const TivOutcome& outcome) { return std::sqrt(Average(outcome.squared_error_m2)); }

SampleMean PairedRmse(const std::vector<TivOutcome>& outcomes,
                      const std::vector<TivOutcome>& reference) {
  std::vector<double> differences;
  for (std::size_t i = 0; i < outcomes.size(); ++i) {
    differences.push_back(RmseOf(outcomes[i]) - RmseOf(reference[i]));
  }
  return MeanOf(differences);
}

// Over drives in which something was decided right.
SampleMean ScansToRight(const std::vector<TivOutcome>& outcomes) {
  std::vector<double> means;
  for (const TivOutcome& outcome : outcomes) {
    if (!outcome.scans_to_right.empty()) means.push_back(Average(outcome.scans_to_right));
  }
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  return means.empty() ? SampleMean{kNaN, kNaN} : MeanOf(means);
}

void AddOverTime(const std::vector<TivOutcome>& outcomes, TivApproximationsRow* row) {
  for (std::size_t t = 0; t < outcomes.front().nees.size(); ++t) {
    row->rmse_over_time_m.push_back(
        RootOf(MeanOver(outcomes, [t](const TivOutcome& one) { return one.squared_error_m2[t]; })));
    row->nees_over_time.push_back(
        MeanOver(outcomes, [t](const TivOutcome& one) { return one.nees[t]; }));
  }
}

void AddCounts(const std::vector<TivOutcome>& outcomes, TivApproximationsRow* row) {
  double moved = 0.0;
  double decided = 0.0;
  for (const TivOutcome& outcome : outcomes) {
    row->leaves_max = std::max(row->leaves_max, outcome.leaves_max);
    moved += outcome.moved;
    decided += static_cast<double>(outcome.scans_to_right.size());
  }
  row->undecided_share = 1.0 - decided / moved;
  row->scans_to_right = ScansToRight(outcomes);
  row->wrong_decisions = MeanOver(
      outcomes, [](const TivOutcome& one) { return static_cast<double>(one.wrong_decisions); });
  row->moved_right = MeanOver(outcomes, [](const TivOutcome& one) {
    return static_cast<double>(one.moved_right) / static_cast<double>(one.moved);
  });
  row->drives_right =
      MeanOver(outcomes, [](const TivOutcome& one) { return one.all_right ? 1.0 : 0.0; });
  row->spurious_modes = MeanOver(
      outcomes, [](const TivOutcome& one) { return static_cast<double>(one.spurious_modes); });
}

TivApproximationsRow Summarize(const TivArm& arm,
                               bool false_alarms,
                               const std::vector<TivOutcome>& outcomes,
                               const std::vector<TivOutcome>& reference) {
  TivApproximationsRow row;
  row.arm = arm;
  row.false_alarms = false_alarms;
  row.rmse_m = RootOf(
      MeanOver(outcomes, [](const TivOutcome& one) { return Average(one.squared_error_m2); }));
  row.nees = MeanOver(outcomes, [](const TivOutcome& one) { return Average(one.nees); });
  row.rmse_paired_m = PairedRmse(outcomes, reference);
  row.leaves = MeanOver(outcomes, [](const TivOutcome& one) { return Average(one.leaves); }).mean;
  AddCounts(outcomes, &row);
  AddOverTime(outcomes, &row);
  return row;
}

}  // namespace

Status TivApproximationsOptions::Validate() const {
  if (drives < 1) return InvalidArgument("drives: {}, expected 1 or more", drives);
  if (threads < 1) return InvalidArgument("threads: {}, expected 1 or more", threads);
  return drive.Validate();
}

std::vector<TivArm> TivArms() {
  using enum NewModeInsertion;
  using enum LeafMerging;
  return {{"gated only", {}},
          {"ungated too", {.update_ungated = true}},
          {"transform", {.transform_alternative = true}},
          {"child", {.insertion = kChild}},
          {"mixture", {.merging = kMixture}},
          {"no merging", {.merging = kNone}},
          {"transform, child", {.transform_alternative = true, .insertion = kChild}},
          {"ungated, transform", {.update_ungated = true, .transform_alternative = true}},
          {"ungated, child", {.update_ungated = true, .insertion = kChild}},
          {"ungated, mixture", {.update_ungated = true, .merging = kMixture}},
          {"ungated, no merging", {.update_ungated = true, .merging = kNone}},
          {"child, no merging", {.insertion = kChild, .merging = kNone}}};
}

TivOutcome RunApproximationsDrive(const ApproximationsDrive& drive,
                                  const TreeSlamOptions& options) {
  TreeSlam slam(options, drive.map.calibration, drive.map);
  slam.BeginRun(drive.start, drive.map.calibration, drive.map.stamp);
  DecisionWatch watch(drive);
  TivOutcome outcome;
  for (std::size_t i = 0; i < drive.scans.size(); ++i) {
    slam.Predict(drive.motions[i]);
    watch.Look(static_cast<int>(i));
    const TreeEvents& events = slam.Correct(drive.scans[i]);
    watch.Take(slam, events.decisions, static_cast<int>(i), &outcome);
    const PoseWithCovariance pose = slam.best().filter.Pose();
    const Se2& truth = drive.T_map_vehicle[i];
    outcome.squared_error_m2.push_back(
        (pose.T_map_vehicle.translation() - truth.translation()).squaredNorm());
    outcome.nees.push_back(SquaredMahalanobis(pose.T_map_vehicle, truth, pose.cov_T_map_vehicle));
    outcome.leaves.push_back(static_cast<double>(slam.leaves().size()));
  }
  slam.EndRun();
  outcome.leaves_max = slam.leaves_max();
  JudgeMap(drive, slam.Content(), &outcome);
  return outcome;
}

StatusOr<std::vector<TivApproximationsRow>> RunTivApproximations(
    const TivApproximationsOptions& options, const std::function<void(double done)>& progress) {
  SHIFTMAP_RETURN_IF_ERROR(options.Validate());
  const std::vector<TivArm> arms = TivArms();
  std::vector<TivApproximationsRow> rows;
  for (const bool false_alarms : {false, true}) {
    std::vector<ApproximationsDrive> drives(static_cast<std::size_t>(options.drives));
    ForEachIndex(drives.size(), options.threads, [&](std::size_t i) {
      drives[i] = SimulateApproximationsDrive(options.drive, options.seed + i, false_alarms);
    });
    std::vector<TivOutcome> reference;
    for (const TivArm& arm : arms) {
      std::vector<TivOutcome> outcomes(drives.size());
      ForEachIndex(drives.size(), options.threads, [&](std::size_t i) {
        outcomes[i] = RunApproximationsDrive(drives[i], arm.options);
      });
      if (reference.empty()) reference = outcomes;
      rows.push_back(Summarize(arm, false_alarms, outcomes, reference));
      if (progress) {
        progress(static_cast<double>(rows.size()) / static_cast<double>(2 * arms.size()));
      }
    }
  }
  return rows;
}

}  // namespace shiftmap
