// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/check/motion_check.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "mapstore/core/median.h"
#include "tools/convert/check/pair_motion.h"

namespace shiftmap {
namespace {

constexpr double kMinPairS = 1.0;
constexpr double kMaxPairS = 10.0;
constexpr double kMaxGapS = 1.0;  // Odometry says nothing of a longer one.

// What a pair must move, by sighting and odometry together, to be above the noise.
constexpr double kMinMotionM = 0.5;

// The same with a mistake undone, which may be one of scale.
constexpr double kMinOtherMotionM = 0.2;

constexpr std::int64_t kMaxPairs = 50'000;
constexpr std::size_t kMaxAnchors = 10'000;

// An alternative changes a pair whose misfit it changes by this, and holds if it fits better in
// this share of them, with this misfit.
constexpr double kChange = 0.2;
constexpr std::int64_t kMinPairs = 20;
constexpr double kBetterShare = 0.8;
constexpr double kGoodMisfit = 0.35;

// Above it, nothing that was tried explains the log.
constexpr double kBadMisfit = 0.5;

// One of the two motions of a pair counts as none below this share of the other.
constexpr double kStillShare = 0.05;

// A gyroscope that works has more noise. [rad/s]
constexpr double kLeastYawRate = 1e-6;

constexpr double kRadPerDegree = std::numbers::pi / 180.0;

// Scales of speed and yaw rate.
struct Units {
  double v;
  double omega;
};
constexpr double kMpsPerMilePerHour = 0.44704;
constexpr std::array<Units, 7> kUnits = {{{1.0, 1.0},
                                          {1.0, kRadPerDegree},
                                          {1e-3, 1.0},
                                          {1.0 / 3.6, 1.0},
                                          {kMpsPerMilePerHour, 1.0},
                                          {1.0, 2.0},
                                          {1.0, 0.5}}};

Eigen::Vector2d AsLogged(const Observation& observation) { return observation.PositionInVehicle(); }
Eigen::Vector2d Turn(const Observation& observation, double xx, double xy, double yx, double yy) {
  const Eigen::Vector2d p = observation.PositionInVehicle();
  return {xx * p.x() + xy * p.y(), yx * p.x() + yy * p.y()};
}
Eigen::Vector2d Mirrored(const Observation& o) { return Turn(o, 1, 0, 0, -1); }
Eigen::Vector2d Reversed(const Observation& o) { return Turn(o, -1, 0, 0, -1); }
Eigen::Vector2d ReversedMirrored(const Observation& o) { return Turn(o, -1, 0, 0, 1); }
Eigen::Vector2d TurnedLeft(const Observation& o) { return Turn(o, 0, -1, 1, 0); }
Eigen::Vector2d TurnedRight(const Observation& o) { return Turn(o, 0, 1, -1, 0); }
Eigen::Vector2d Swapped(const Observation& o) { return Turn(o, 0, 1, 1, 0); }
Eigen::Vector2d SwappedReversed(const Observation& o) { return Turn(o, 0, -1, -1, 0); }
Eigen::Vector2d Feet(const Observation& o) { return 0.3048 * AsLogged(o); }
Eigen::Vector2d Millimetres(const Observation& o) { return 1e-3 * AsLogged(o); }
Eigen::Vector2d Degrees(const Observation& observation) {
  Observation undone = observation;
  if (observation.kind == Observation::Kind::kRangeBearing) undone.z.y() *= kRadPerDegree;
  return AsLogged(undone);
}

struct Alternative {
  const char* code;
  const char* message;
  const char* advice;
  Eigen::Vector2d (*position)(const Observation&);
  std::size_t units;
};

constexpr const char* kSignAdvice =
    "bearings and yaw rates are counter-clockwise, y is to the left; turn the sign of one";
constexpr const char* kWheelAdvice =
    "see whether the yaw rate is made from one wheel, or with another wheel base";
constexpr const char* kMountAdvice =
    "give the sensor's mounting on the vehicle; x is forward, also in the speed";

constexpr std::array<Alternative, MotionCheck::kAlternatives> kTried = {{
    {"bearing_sign",
     "landmarks turn the wrong way when the vehicle turns: the sign of bearings (of y) or of the "
     "yaw rate is wrong",
     kSignAdvice,
     Mirrored,
     0},
    {"sensor_reversed",
     "landmarks ahead fall behind the wrong way: the sensor looks backwards, or the speed's sign "
     "is "
     "wrong",
     kMountAdvice,
     Reversed,
     0},
    {"sensor_reversed_mirrored",
     "the sensor looks backwards (or the speed's sign is wrong), and bearings or the yaw rate have "
     "the wrong sign",
     kSignAdvice,
     ReversedMirrored,
     0},
    {"sensor_turned",
     "positions are turned by a quarter: the sensor's x axis points to the vehicle's left",
     kMountAdvice,
     TurnedLeft,
     0},
    {"sensor_turned",
     "positions are turned by a quarter: the sensor's x axis points to the vehicle's right",
     kMountAdvice,
     TurnedRight,
     0},
    {"axes_swapped", "x and y of positions are swapped", "x is forward, y to the left", Swapped, 0},
    {"axes_swapped",
     "x and y of positions are swapped and point the wrong way",
     "x is forward, y to the left",
     SwappedReversed,
     0},
    {"range_millimetres",
     "ranges are a thousand times too large",
     "write ranges in metres",
     Millimetres,
     0},
    {"range_feet", "ranges fit the motion in feet", "write ranges in metres", Feet, 0},
    {"bearing_degrees",
     "bearings fit the motion in degrees",
     "write bearings in radians",
     Degrees,
     0},
    {"yaw_rate_unit",
     "yaw rates fit the landmarks in degrees per second",
     "write radians per second",
     AsLogged,
     1},
    {"speed_unit",
     "speeds fit the landmarks in millimetres per second",
     "write metres per second",
     AsLogged,
     2},
    {"speed_unit",
     "speeds fit the landmarks in kilometres per hour",
     "write metres per second",
     AsLogged,
     3},
    {"speed_unit",
     "speeds fit the landmarks in miles per hour",
     "write metres per second",
     AsLogged,
     4},
    {"yaw_rate_scale",
     "yaw rates are half of what landmarks show, or less",
     kWheelAdvice,
     AsLogged,
     5},
    {"yaw_rate_scale",
     "yaw rates are twice what landmarks show, or more",
     kWheelAdvice,
     AsLogged,
     6},
    {"bearing_sign",
     "yaw rates fit the landmarks in degrees per second and with the other sign",
     kSignAdvice,
     Mirrored,
     1},
}};

PairMotion MotionOf(const Eigen::Vector2d& p1,
                    const Eigen::Vector2d& p2,
                    const Se2& T_first_second) {
  return {p2 - p1, T_first_second.Inverse() * p1 - p1};
}

}  // namespace

MotionCheck::MotionCheck() = default;

void MotionCheck::MoveTo(Stamp stamp) {
  if (!odometry_) return;
  const double seconds = ToSeconds(stamp - at_);
  if (seconds < 0.0) return;
  if (seconds > kMaxGapS) {
    anchors_.clear();
  } else {
    for (std::size_t i = 0; i < kOdometries; ++i) {
      const Eigen::Vector3d twist(kUnits[i].v * odometry_->v_mps * seconds,
                                  0.0,
                                  kUnits[i].omega * odometry_->omega_radps * seconds);
      T_begin_vehicle_[i] = T_begin_vehicle_[i] * Se2::Exp(twist);
    }
  }
  at_ = stamp;
}

void MotionCheck::Add(const OdometrySample& sample) {
  MoveTo(sample.stamp);
  if (!odometry_) at_ = sample.stamp;
  odometry_ = sample;
  turns_ |= std::abs(sample.omega_radps) > kLeastYawRate;
}

void MotionCheck::Add(const Scan& scan) {
  if (!odometry_ || scan.stamp < at_) return;
  MoveTo(scan.stamp);
  for (const Observation* const observed : IdentifiedOnce(scan)) {
    const Observation& observation = *observed;
    const std::string& signature = observation.signature.text();
    const Anchor now{scan.stamp, observation, T_begin_vehicle_};
    const auto known = anchors_.find(signature);
    if (known == anchors_.end()) {
      if (anchors_.size() < kMaxAnchors) anchors_.emplace(signature, now);
      continue;
    }
    Anchor& anchor = known->second;
    const double seconds = ToSeconds(scan.stamp - anchor.stamp);
    if (seconds < kMinPairS) continue;
    const bool old = seconds > kMaxPairS;
    const PairMotion motion = MotionOf(AsLogged(anchor.observation),
                                       AsLogged(observation),
                                       anchor.T_begin_vehicle[0].Inverse() * T_begin_vehicle_[0]);
    if (!old && motion.total() < kMinMotionM) continue;
    if (!old && pairs_ < kMaxPairs) AddPair(anchor, observation);
    anchor = now;
  }
}

void MotionCheck::AddPair(const Anchor& first, const Observation& second) {
  Poses T_first_second;
  for (std::size_t i = 0; i < kOdometries; ++i) {
    T_first_second[i] = first.T_begin_vehicle[i].Inverse() * T_begin_vehicle_[i];
  }
  const PairMotion logged =
      MotionOf(AsLogged(first.observation), AsLogged(second), T_first_second[0]);
  const double misfit = logged.misfit();
  ++pairs_;
  misfits_.push_back(static_cast<float>(misfit));
  if (logged.expected.norm() < kStillShare * logged.seen.norm()) ++odometry_still_;
  if (logged.seen.norm() < kStillShare * logged.expected.norm()) ++landmark_still_;
  for (std::size_t i = 0; i < kAlternatives; ++i) {
    const Alternative& tried = kTried[i];
    const PairMotion motion = MotionOf(
        tried.position(first.observation), tried.position(second), T_first_second[tried.units]);
    const double other = motion.misfit();
    if (other <= kBadMisfit) ++tallies_[i].fitting;
    if (motion.total() < kMinOtherMotionM || std::abs(other - misfit) < kChange) continue;
    if (i == 0) ++turning_;
    Tally& tally = tallies_[i];
    ++tally.changed;
    if (other < misfit) ++tally.better;
    tally.misfits.push_back(static_cast<float>(other));
  }
}

std::optional<double> MotionCheck::MedianMisfit() const {
  if (misfits_.empty()) return std::nullopt;
  return static_cast<double>(Median(misfits_));
}

bool MotionCheck::Holds(const Tally& tally) const {
  return tally.changed >= kMinPairs && 2 * tally.fitting >= pairs_ &&
         static_cast<double>(tally.better) >= kBetterShare * static_cast<double>(tally.changed) &&
         static_cast<double>(Median(tally.misfits)) <= kGoodMisfit;
}

bool MotionCheck::ReportFrozen(Findings* findings) const {
  const double most = kBetterShare * static_cast<double>(pairs_);
  if (static_cast<double>(odometry_still_) >= most) {
    findings->push_back({Severity::kWarning,
                         "odometry_frozen",
                         "odometry against scans",
                         fmt::format("landmarks move and the odometry does not, in {} of {} pairs",
                                     odometry_still_,
                                     pairs_),
                         "see whether the odometry driver reports velocities"});
    return true;
  }
  if (static_cast<double>(landmark_still_) >= most) {
    findings->push_back(
        {Severity::kWarning,
         "detections_frozen",
         "odometry against scans",
         fmt::format("the vehicle moves and landmarks move along, in {} of {} pairs",
                     landmark_still_,
                     pairs_),
         "see whether the detector repeats its last result, or gives positions in "
         "the map"});
    return true;
  }
  return false;
}

void MotionCheck::Report(Findings* findings) const {
  if (pairs_ < kMinPairs) {
    findings->push_back(
        {Severity::kNote,
         "motion_unknown",
         "odometry against scans",
         fmt::format("{} pairs of sightings while driving, {} are needed to compare directions",
                     pairs_,
                     kMinPairs),
         "drive past landmarks and turn among them"});
    return;
  }
  const Alternative* best = nullptr;
  const Tally* evidence = nullptr;
  for (std::size_t i = 0; i < kAlternatives; ++i) {
    const Tally& tally = tallies_[i];
    if (!Holds(tally)) continue;
    if (evidence != nullptr &&
        2 * tally.better - tally.changed <= 2 * evidence->better - evidence->changed) {
      continue;
    }
    best = &kTried[i];
    evidence = &tally;
  }
  // Without turns in the odometry bearings seem too large.
  if (!turns_ && (best != nullptr || *MedianMisfit() > kBadMisfit)) {
    if (ReportFrozen(findings)) return;
    findings->push_back({Severity::kWarning,
                         "yaw_rate_zero",
                         "odometry against scans",
                         "landmarks turn and the yaw rate is 0 throughout",
                         "see whether the odometry driver reports yaw rates"});
    return;
  }
  if (best != nullptr) {
    findings->push_back({Severity::kWarning,
                         best->code,
                         "odometry against scans",
                         fmt::format("{}; {} of {} pairs of sightings fit then",
                                     best->message,
                                     evidence->better,
                                     evidence->changed),
                         best->advice});
    return;
  }
  if (ReportFrozen(findings)) return;
  if (*MedianMisfit() > kBadMisfit) {
    findings->push_back({Severity::kWarning,
                         "motion_misfit",
                         "odometry against scans",
                         fmt::format("landmarks do not move as the odometry says: median misfit "
                                     "{:.2f} of {} pairs",
                                     *MedianMisfit(),
                                     pairs_),
                         "compare both clocks, and the sensor's mounting"});
  } else if (turning_ < kMinPairs) {
    findings->push_back({Severity::kNote,
                         "turns_few",
                         "odometry against scans",
                         "the vehicle hardly turns among landmarks: signs cannot be compared",
                         "turn among landmarks once"});
  }
}

}  // namespace shiftmap
