// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/localizer_bodies.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>
#include <optional>
#include <utility>

#include "localizer/localizer.h"
#include "mapper/parallel.h"
#include "tools/experiment/dice.h"

namespace shiftmap {
namespace {

const Duration kMaxTruthGap = FromSeconds(1.0);

constexpr double kDriven = 600.0;      // Of each log. [s]
constexpr double kLeaveRate = 1e-6;    // Of a landmark: displacements are rare. [1/s]
constexpr double kMaxTurn = 0.47;      // Of a body. [rad]
constexpr double kWrong = 0.5;         // A pose is, beyond this error. [m]
constexpr double kElsewhere = 0.3;     // A landmark is, beyond this distance. [m]
constexpr double kMaxNees = 1000.0;    // One diverged run must not be the mean of all.
constexpr std::size_t kMinBody = 3;    // Landmarks.
constexpr std::size_t kRackShare = 6;  // Of the landmarks, one in as many.
constexpr std::size_t kSideShare = 4;

Eigen::Vector2d DrawDirection(Dice* dice) {
  const double yaw = dice->Uniform(-std::numbers::pi, std::numbers::pi);
  return {std::cos(yaw), std::sin(yaw)};
}

// The landmarks of a drawn rack or side.
std::vector<Signature> DrawBody(const Layout& places, DisplacedPart part, Dice* dice) {
  const bool rack = part == DisplacedPart::kRack;
  const Eigen::Vector2d direction = DrawDirection(dice);
  const double drawn = dice->Uniform(0.0, static_cast<double>(places.size()));
  const Eigen::Vector2d& middle = std::next(places.begin(), static_cast<int>(drawn))->second;
  std::vector<std::pair<double, Signature>> order;
  for (const auto& [signature, place] : places) {
    order.emplace_back(rack ? (place - middle).norm() : -place.dot(direction), signature);
  }
  std::sort(order.begin(), order.end());
  const std::size_t share = places.size() / (rack ? kRackShare : kSideShare);
  order.resize(std::min(std::max(share, kMinBody), order.size()));
  std::vector<Signature> body;
  for (const auto& [distance, signature] : order) body.push_back(signature);
  return body;
}

Layout DrawDisplaced(
    const Layout& places, DisplacedPart part, double displaced_m, bool turned, Dice* dice) {
  const std::vector<Signature> body = DrawBody(places, part, dice);
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const Signature& signature : body) {
    mean += places.at(signature) / static_cast<double>(body.size());
  }
  const Eigen::Vector2d displaced = mean + displaced_m * DrawDirection(dice);
  const double turn = dice->Uniform(-kMaxTurn, kMaxTurn);
  const Se2 T_map_body(displaced, turned ? turn : 0.0);
  Layout mapped = places;
  for (const Signature& signature : body) {
    mapped[signature] = T_map_body * Eigen::Vector2d(places.at(signature) - mean);
  }
  return mapped;
}

PoseWithCovariance DrawStart(const TrueShift& shift, const LayoutOptions& options, Dice* dice) {
  const Eigen::Vector3d sd(options.sd_start_m, options.sd_start_m, options.sd_start_rad);
  const Eigen::Matrix3d cov = sd.cwiseAbs2().asDiagonal();
  const Stamp begin = shift.run.scans.front().stamp;
  const Se2 T_map_vehicle = Interpolate(shift.truth, begin, kMaxTruthGap).value();
  return {T_map_vehicle * Se2::Exp(dice->Normal3(cov)), cov};
}

MapSnapshot MapOf(const DisplacedRun& run,
                  const Calibration& calibration,
                  const LayoutOptions& options) {
  MapContent content = LayoutMap({run.mapped}, 0, calibration, options);
  for (LandmarkGroup& group : content.groups) group.chain = ModeChain::Uniform(1, kLeaveRate);
  content.stamp = run.shift->run.scans.front().stamp;
  return MapSnapshot("utias", VersionNumber(1), "", content);
}

void CountPose(const PoseEstimate& estimate,
               const Se2& truth,
               LocalizerState state,
               DisplacedTally* tally) {
  static const double kOutside = ChiSquareQuantile(0.999, 3);
  const PoseWithCovariance& pose = estimate.pose;
  const double error = (pose.T_map_vehicle.translation() - truth.translation()).norm();
  const double nees = SquaredMahalanobis(pose.T_map_vehicle, truth, pose.cov_T_map_vehicle);
  const bool lost = state == LocalizerState::kLost;
  const bool wrong = error > kWrong;
  ++tally->poses;
  tally->wrong += wrong;
  tally->sure += wrong && !lost && nees > kOutside;
  tally->lost += lost;
  tally->unknown += state == LocalizerState::kUnknownChange;
  tally->worst_m = std::max(tally->worst_m, error);
  tally->nees_sum += std::min(nees, kMaxNees);
}

StatusOr<DisplacedTally> LocalizeDisplaced(const DisplacedRun& run,
                                           const Calibration& calibration,
                                           const LayoutOptions& options) {
  LocalizerOptions localizer_options;
  localizer_options.initial_pose = run.start;
  Localizer localizer(MapOf(run, calibration, options), localizer_options);
  const Stamp begin = run.shift->run.scans.front().stamp;
  const Stamp end = begin + FromSeconds(kDriven);
  const Stamp settled = begin + FromSeconds(options.settled_after_s);
  DisplacedTally tally;
  tally.runs = 1;
  const auto drive = [&](const RunEvent& event) -> Status {
    if (StampOf(event) > end) return OkStatus();
    SHIFTMAP_RETURN_IF_ERROR(localizer.Process(event));
    for (const PoseEstimate& estimate : localizer.new_estimates()) {
      if (estimate.stamp < settled) continue;
      const auto truth = Interpolate(run.shift->truth, estimate.stamp, kMaxTruthGap);
      if (truth) CountPose(estimate, *truth, localizer.state(), &tally);
    }
    return OkStatus();
  };
  SHIFTMAP_RETURN_IF_ERROR(ForEachEvent(run.shift->run, drive));
  localizer.Finish();
  for (const Decision& decision : localizer.decisions()) {
    if (decision.stamp < settled) continue;
    const Eigen::Vector2d& place = run.places.at(decision.signature);
    const bool elsewhere = (run.mapped.at(decision.signature) - place).norm() > kElsewhere;
    ++tally.decisions;
    tally.wrong_decisions += (decision.mode == kAbsent) != elsewhere;
  }
  return tally;
}

}  // namespace

std::vector<DisplacedRun> DrawDisplacedRuns(const UtiasRecordings& recordings,
                                            DisplacedPart part,
                                            double displaced_m,
                                            int draws,
                                            const LayoutOptions& options,
                                            std::uint64_t* next_seed) {
  std::vector<DisplacedRun> runs;
  for (const TrueShift& shift : recordings.shifts) {
    const auto holds = static_cast<std::size_t>(shift.layout);
    const Layout& places = recordings.layouts[holds];
    const auto add = [&](const Layout& mapped, Dice* dice) {
      runs.push_back({&shift, places, mapped, DrawStart(shift, options, dice)});
    };
    if (part == DisplacedPart::kNothing) {
      Dice dice((*next_seed)++);
      add(places, &dice);
    } else if (part == DisplacedPart::kLayout) {
      for (std::size_t layout = 0; layout < recordings.layouts.size(); ++layout) {
        if (layout == holds) continue;
        Dice dice((*next_seed)++);
        add(recordings.layouts[layout], &dice);
      }
    } else {
      for (int draw = 0; draw < draws; ++draw) {
        Dice dice((*next_seed)++);
        add(DrawDisplaced(places, part, displaced_m, draw % 2 == 0, &dice), &dice);
      }
    }
  }
  return runs;
}

void DisplacedTally::Add(const DisplacedTally& other) {
  runs += other.runs;
  poses += other.poses;
  wrong += other.wrong;
  sure += other.sure;
  lost += other.lost;
  unknown += other.unknown;
  worst_m = std::max(worst_m, other.worst_m);
  nees_sum += other.nees_sum;
  decisions += other.decisions;
  wrong_decisions += other.wrong_decisions;
}

StatusOr<DisplacedTally> TallyDisplaced(const std::vector<DisplacedRun>& runs,
                                        const Calibration& calibration,
                                        const LayoutOptions& options,
                                        int threads) {
  std::vector<std::optional<StatusOr<DisplacedTally>>> tallies(runs.size());
  ForEachIndex(runs.size(), threads, [&](std::size_t i) {
    tallies[i] = LocalizeDisplaced(runs[i], calibration, options);
  });
  DisplacedTally sum;
  for (const std::optional<StatusOr<DisplacedTally>>& tally : tallies) {
    if (!tally->ok()) return tally->status();
    sum.Add(tally->value());
  }
  return sum;
}

}  // namespace shiftmap
