// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/localizer_states_world.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <random>
#include <string>

#include "localizer/filter/known_map_filter.h"
#include "mapstore/geometry/angle.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

constexpr double kPeriod = 0.05;  // Of odometry. [s]
constexpr int kSamplesPerScan = 5;
constexpr double kBeforeCauseS = 25.0;
constexpr double kFailureS = 15.0;  // Of odometry.
constexpr int kMinScansSeen = 20;
constexpr double kModeSd = 0.04;  // [m]

class ShiftDraw {
 public:
  ShiftDraw(ShiftCause cause, std::uint64_t seed) : cause_(cause), random_(seed) {}

  CausedShift Draw() {
    DrawWorld();
    Drive();
    ChangeWorld();
    Look();
    return std::move(shift_);
  }

 private:
  double Uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  int Integer(int low, int high) { return std::uniform_int_distribution<int>(low, high)(random_); }
  double Normal() { return normal_(random_); }
  Eigen::Vector2d Place() { return {Uniform(-half_, half_), Uniform(-half_, half_)}; }

  void DrawWorld() {
    const int groups = Integer(8, 60);
    half_ = 0.5 * Uniform(1.5, 3.5) * std::sqrt(groups);
    MapContent& content = shift_.content;
    std::vector<Eigen::Matrix2d> marginals;
    for (int i = 0; i < groups; ++i) {
      LandmarkGroup group;
      group.signature = Signature(std::to_string(100 + i));
      const int modes = cause_ == ShiftCause::kModeChange ? 2 : Integer(1, 3);
      for (int number = 1; number <= modes; ++number)
        group.modes.push_back(DrawMode(group, number));
      for (const Mode& mode : group.modes) marginals.push_back(mode.cov_p_map_landmark);
      group.chain = ModeChain::Uniform(modes, 1e-6);
      group.probabilities = Eigen::VectorXd::Constant(modes + 1, 0.1 / modes);
      group.probabilities[0] = 0.02;
      group.probabilities[1] += 1.0 - group.probabilities.sum();
      truth_.push_back(group.modes[0].p_map_landmark +
                       kModeSd * Eigen::Vector2d(Normal(), Normal()));
      content.groups.push_back(group);
    }
    content.covariance = JointCovariance(marginals, {});
    content.stamp = begin_;
    SensorCalibration& sensor = content.calibration.sensor;
    sensor.max_range_m = Uniform(6.0, 12.0);
    sensor.max_bearing_rad = Uniform(0.6, 1.6);
    sensor.sd_range_m = Uniform(0.02, 0.12);
    sensor.sd_bearing_rad = Uniform(0.01, 0.035);
    sensor.detection_probability = Uniform(0.5, 0.95);
    misread_ = Uniform(0.0, 0.02);
  }

  Mode DrawMode(const LandmarkGroup& group, int number) {
    Mode mode;
    mode.number = ModeNumber(number);
    mode.cov_p_map_landmark = Eigen::Matrix2d::Identity() * kModeSd * kModeSd;
    mode.p_map_landmark = PlaceApart(group, Eigen::Vector2d::Zero(), 2.0 * half_);
    return mode;
  }

  // A place at least 1.2 m from every mode of the group, and in the square of `reach` about `near`.
  Eigen::Vector2d PlaceApart(const LandmarkGroup& group,
                             const Eigen::Vector2d& near,
                             double reach) {
    for (;;) {
      const Eigen::Vector2d p = Place();
      if ((p - near).lpNorm<Eigen::Infinity>() > reach) continue;
      if (std::all_of(group.modes.begin(), group.modes.end(), [&](const Mode& mode) {
            return (mode.p_map_landmark - p).norm() > 1.2;
          })) {
        return p;
      }
    }
  }

  // Poses and odometry, from the vehicle's own calibration; the cause strikes at cause_sample_.
  void Drive() {
    const OdometryCalibration& odometry = shift_.content.calibration.odometry;
    const double scale_v = std::exp(odometry.sd_log_scale * Normal());
    const double scale_omega = std::exp(odometry.sd_log_scale * Normal());
    const double speed = Uniform(0.4, 1.2);
    Se2 pose(Place() * 0.6, Uniform(-M_PI, M_PI));
    Eigen::Vector2d goal = Place();
    const auto samples = static_cast<int>((kBeforeCauseS + kAfterCauseS) / kPeriod);
    for (int i = 0; i < samples; ++i) {
      const bool failing = i >= cause_sample_ && i < cause_sample_ + kFailureS / kPeriod;
      if (i == cause_sample_) pose = Carried(pose);
      poses_.push_back(pose);
      if ((goal - pose.translation()).norm() < 1.0) goal = Place();
      const Eigen::Vector2d q = pose.Inverse() * goal;
      const double bearing = std::atan2(q.y(), q.x());
      double omega = std::clamp(1.5 * bearing, -0.6, 0.6);
      double v = speed * std::max(0.15, std::cos(bearing));
      const double true_v = v;
      OdometrySample sample{StampAt(i), v, omega};
      if (failing) {
        if (cause_ == ShiftCause::kWheelSlip) v = omega = 0.0;
        if (cause_ == ShiftCause::kOdometryDoubled) sample.v_mps = 2.0 * true_v;
        if (cause_ == ShiftCause::kOdometryFrozen) {
          sample.v_mps = samples_.back().v_mps;
          sample.omega_radps = samples_.back().omega_radps;
        }
      }
      samples_.push_back(sample);
      const double root = std::sqrt(kPeriod);
      const Eigen::Vector3d noise(odometry.noise_v * root * Normal(),
                                  odometry.noise_v * root * Normal(),
                                  odometry.noise_omega * root * Normal());
      const Eigen::Vector3d twist(scale_v * v * kPeriod, 0.0, scale_omega * omega * kPeriod);
      const bool stands = v == 0.0 && omega == 0.0;
      pose = pose * Se2::Exp(stands ? Eigen::Vector3d::Zero().eval() : (twist + noise).eval());
    }
  }

  Se2 Carried(const Se2& from) {
    if (cause_ == ShiftCause::kNudged) {
      const double direction = Uniform(-M_PI, M_PI);
      return Se2(
          from.translation() + 0.5 * Eigen::Vector2d(std::cos(direction), std::sin(direction)),
          from.yaw() + Uniform(-0.2, 0.2));
    }
    if (cause_ != ShiftCause::kKidnapped) return from;
    for (;;) {
      const Se2 to(Place(), Uniform(-M_PI, M_PI));
      if ((to.translation() - from.translation()).norm() > 3.0) return to;
    }
  }

  Stamp StampAt(int sample) const { return begin_ + FromSeconds(sample * kPeriod); }

  bool InView(const Se2& T_map_vehicle, const Eigen::Vector2d& p_map) const {
    constexpr double kMinRange = 0.5;
    const SensorCalibration& sensor = shift_.content.calibration.sensor;
    const Eigen::Vector2d q = T_map_vehicle.Inverse() * p_map;
    return q.norm() > kMinRange && q.norm() < sensor.max_range_m &&
           std::abs(std::atan2(q.y(), q.x())) < sensor.max_bearing_rad;
  }

  int ScansSeen(const Eigen::Vector2d& p_map) const {
    int seen = 0;
    for (std::size_t i = static_cast<std::size_t>(cause_sample_); i < poses_.size();
         i += kSamplesPerScan) {
      seen += InView(poses_[i], p_map);
    }
    return seen;
  }

  void ChangeWorld() {
    after_.assign(truth_.begin(), truth_.end());
    const bool map_changes = cause_ == ShiftCause::kModeChange || cause_ == ShiftCause::kMoved ||
                             cause_ == ShiftCause::kRemoved || cause_ == ShiftCause::kRackMoved;
    // Half of the changes were there before the shift began.
    if (map_changes && Uniform(0.0, 1.0) < 0.5) change_sample_ = 0;
    if (!map_changes && cause_ != ShiftCause::kDuplicate) return;
    std::vector<std::size_t> order(truth_.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::shuffle(order.begin(), order.end(), random_);
    const auto seen = static_cast<int>(std::count_if(
        truth_.begin(), truth_.end(), [&](const Eigen::Vector2d& p) { return ScansSeen(p) > 0; }));
    if (cause_ == ShiftCause::kRackMoved) {
      MoveRack(order, Integer(3, std::clamp(seen / 3, 3, 6)));
      return;
    }
    const int wanted = map_changes ? Integer(1, std::max(1, seen / 3)) : 1;
    for (const std::size_t i : order) {
      if (shift_.affected == wanted) break;
      if (ScansSeen(truth_[i]) >= kMinScansSeen) shift_.affected += Affect(i);
    }
  }

  // Displaces the first landmark of an order that is seen for long enough, and its neighbours.
  void MoveRack(std::vector<std::size_t> order, int size) {
    const auto middle = std::find_if(order.begin(), order.end(), [&](std::size_t i) {
      return ScansSeen(truth_[i]) >= kMinScansSeen;
    });
    if (middle == order.end()) return;
    const Eigen::Vector2d p_middle = truth_[*middle];
    std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
      return (truth_[a] - p_middle).norm() < (truth_[b] - p_middle).norm();
    });
    const double direction = Uniform(-M_PI, M_PI);
    const double turn = Uniform(0.0, 1.0) < 0.5 ? 0.0 : Uniform(-0.5, 0.5);
    const Se2 moved(
        p_middle + Uniform(0.5, 3.0) * Eigen::Vector2d(std::cos(direction), std::sin(direction)),
        turn);
    for (int n = 0; n < size; ++n) {
      const std::size_t i = order[static_cast<std::size_t>(n)];
      after_[i] = moved * (truth_[i] - p_middle).eval();
    }
    shift_.affected = size;
  }

  bool Affect(std::size_t i) {
    const LandmarkGroup& group = shift_.content.groups[i];
    if (cause_ == ShiftCause::kRemoved) {
      after_[i].reset();
      return true;
    }
    constexpr int kTries = 20;
    for (int n = 0; n < kTries; ++n) {
      Eigen::Vector2d p = PlaceApart(group, truth_[i], cause_ == ShiftCause::kMoved ? 5.0 : 2.0);
      if (cause_ == ShiftCause::kModeChange) {
        p = group.modes[1].p_map_landmark + kModeSd * Eigen::Vector2d(Normal(), Normal());
      }
      if (ScansSeen(p) < kMinScansSeen) continue;
      if (cause_ == ShiftCause::kDuplicate) {
        copy_ = {i, p};
      } else {
        after_[i] = p;
      }
      return true;
    }
    return false;
  }

  void Look() {
    const SensorCalibration& sensor = shift_.content.calibration.sensor;
    const Eigen::Vector2d sd(sensor.sd_range_m, sensor.sd_bearing_rad);
    range_scale_ = std::exp(KnownMapFilter::kSdLogRangeScale * Normal());
    bias_ = KnownMapFilter::kBiasShare * sd.cwiseProduct(Eigen::Vector2d(Normal(), Normal()));
    for (std::size_t i = 0; i < poses_.size(); ++i) {
      const auto sample = static_cast<int>(i);
      if (sample % kSamplesPerScan == 0) {
        Scan scan{StampAt(sample), {}};
        for (std::size_t j = 0; j < truth_.size(); ++j) {
          const std::optional<Eigen::Vector2d> p = sample < change_sample_ ? truth_[j] : after_[j];
          if (p) See(poses_[i], j, *p, &scan);
        }
        if (copy_ && sample >= change_sample_) See(poses_[i], copy_->first, copy_->second, &scan);
        shift_.T_map_vehicle.push_back(poses_[i]);
        shift_.events.emplace_back(std::move(scan));
      }
      shift_.events.emplace_back(samples_[i]);
    }
    shift_.cause = StampAt(change_sample_);
    shift_.over = shift_.cause;
    if (IsPoseFailure(cause_) && cause_ != ShiftCause::kKidnapped &&
        cause_ != ShiftCause::kNudged) {
      shift_.over = shift_.cause + FromSeconds(kFailureS);
    }
    constexpr double kSd = 0.1;
    constexpr double kYawSd = 0.04;
    const Eigen::Vector3d error(kSd * Normal(), kSd * Normal(), kYawSd * Normal());
    shift_.start.T_map_vehicle = poses_.front() * Se2::Exp(error);
    shift_.start.cov_T_map_vehicle =
        Eigen::Vector3d(kSd * kSd, kSd * kSd, kYawSd * kYawSd).asDiagonal();
  }

  void See(const Se2& T_map_vehicle, std::size_t j, const Eigen::Vector2d& p_map, Scan* scan) {
    const SensorCalibration& sensor = shift_.content.calibration.sensor;
    if (!InView(T_map_vehicle, p_map)) return;
    if (Uniform(0.0, 1.0) > sensor.detection_probability) return;
    const Eigen::Vector2d q = T_map_vehicle.Inverse() * p_map;
    const bool misread = Uniform(0.0, 1.0) < misread_;
    const std::size_t read =
        misread ? static_cast<std::size_t>(Integer(0, static_cast<int>(truth_.size()) - 1)) : j;
    Observation observation;
    observation.signature = shift_.content.groups[read].signature;
    observation.z = Eigen::Vector2d(range_scale_ * q.norm(), std::atan2(q.y(), q.x())) + bias_ +
                    Eigen::Vector2d(sensor.sd_range_m * Normal(), sensor.sd_bearing_rad * Normal());
    observation.z.x() = std::max(observation.z.x(), 0.05);
    scan->observations.push_back(observation);
  }

  ShiftCause cause_;
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
  CausedShift shift_;
  const Stamp begin_ = StampFromSeconds(1000.0);
  const int cause_sample_ = static_cast<int>(kBeforeCauseS / kPeriod);
  int change_sample_ = cause_sample_;  // When the world changes.
  double half_ = 1.0;                  // Side of the world / 2. [m]
  double misread_ = 0.0;
  double range_scale_ = 1.0;
  Eigen::Vector2d bias_ = Eigen::Vector2d::Zero();
  std::vector<Eigen::Vector2d> truth_;                 // By group, before the change.
  std::vector<std::optional<Eigen::Vector2d>> after_;  // By group, after it.
  std::optional<std::pair<std::size_t, Eigen::Vector2d>> copy_;
  std::vector<Se2> poses_;               // By sample.
  std::vector<OdometrySample> samples_;  // By sample.
};

}  // namespace

const char* ToString(ShiftCause cause) {
  switch (cause) {
    case ShiftCause::kNothing:
      return "nothing";
    case ShiftCause::kModeChange:
      return "mode change";
    case ShiftCause::kMoved:
      return "moved";
    case ShiftCause::kRemoved:
      return "removed";
    case ShiftCause::kKidnapped:
      return "kidnapped";
    case ShiftCause::kNudged:
      return "nudged";
    case ShiftCause::kWheelSlip:
      return "wheel slip";
    case ShiftCause::kOdometryDoubled:
      return "odometry doubled";
    case ShiftCause::kOdometryFrozen:
      return "odometry frozen";
    case ShiftCause::kDuplicate:
      return "duplicate";
    case ShiftCause::kRackMoved:
      return "rack moved";
  }
  return "";
}

bool IsPoseFailure(ShiftCause cause) {
  return cause >= ShiftCause::kKidnapped && cause <= ShiftCause::kOdometryFrozen;
}

CausedShift DrawShift(ShiftCause cause, std::uint64_t seed) {
  // Shifts of one cause never share a seed; a few of two causes do.
  constexpr std::uint64_t kStride = 10;
  return ShiftDraw(cause, seed * kStride + static_cast<std::uint64_t>(cause)).Draw();
}

}  // namespace shiftmap
