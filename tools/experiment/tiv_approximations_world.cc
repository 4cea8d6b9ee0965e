// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/tiv_approximations_world.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

namespace shiftmap {
namespace {

// Fates of the landmarks along the way, shuffled for each drive.
constexpr LandmarkFate kFates[] = {LandmarkFate::kStays,
                                   LandmarkFate::kStays,
                                   LandmarkFate::kStays,
                                   LandmarkFate::kStays,
                                   LandmarkFate::kStays,
                                   LandmarkFate::kKnownPlace,
                                   LandmarkFate::kNewPlace,
                                   LandmarkFate::kNewPlace,
                                   LandmarkFate::kThirdPlace};

// Along the way, and how far beside it landmarks stand.
constexpr double kFirstLandmark = 3.0;  // [m]
constexpr double kBesideMin = 1.0;      // [m]
constexpr double kBesideMax = 3.5;      // [m]
constexpr double kMaxYawRate = 0.03;    // [rad/s]

// Priors of a landmark in the map: `absent` and its modes.
constexpr double kAbsentPrior = 0.1;
constexpr double kSecondPrior = 0.2;
constexpr double kLeaveRate = 1e-5;  // [1/s]

// The scales of odometry are known: drives have slip alone.
constexpr double kKnownScale = 1e-6;

// Drives differ in all that is random, and false alarms in nothing else.
constexpr std::uint64_t kFalseAlarmSeed = 0x9E3779B97F4A7C15;

// A place that is none of the others.
Eigen::Vector2d DrawPlace(const ApproximationsDriveOptions& options,
                          const std::vector<Eigen::Vector2d>& others,
                          Dice* dice) {
  while (true) {
    const double distance = dice->Uniform(options.shift_min_m, options.shift_max_m);
    const double angle = dice->Uniform(-M_PI, M_PI);
    const Eigen::Vector2d step(std::cos(angle), std::sin(angle));
    const Eigen::Vector2d place = others.front() + distance * step;
    const bool apart = std::all_of(others.begin(), others.end(), [&](const Eigen::Vector2d& p) {
      return (p - place).norm() >= options.shift_min_m;
    });
    if (apart) return place;
  }
}

LandmarkGroup MakeGroup(int index,
                        const std::vector<Eigen::Vector2d>& places,
                        double sd_mode_m,
                        double absent_prior,
                        double second_prior) {
  LandmarkGroup group;
  group.signature = Signature(fmt::format("L{:02}", index));
  for (const Eigen::Vector2d& place : places) {
    Mode mode;
    mode.number = group.NextNumber();
    mode.p_map_landmark = place;
    mode.cov_p_map_landmark = Eigen::Matrix2d::Identity() * sd_mode_m * sd_mode_m;
    group.modes.push_back(mode);
  }
  const int modes = static_cast<int>(places.size());
  group.chain = ModeChain::Uniform(modes, kLeaveRate);
  group.probabilities = Eigen::VectorXd::Constant(modes + 1, second_prior);
  group.probabilities(0) = absent_prior;
  group.probabilities(1) = 1.0 - absent_prior - second_prior * (modes - 1);
  return group;
}

void DrawLandmark(const ApproximationsDriveOptions& options,
                  LandmarkFate fate,
                  double x_m,
                  ApproximationsDrive* drive,
                  Dice* dice) {
  const double side = dice->Coin(0.5) ? 1.0 : -1.0;
  std::vector<Eigen::Vector2d> places = {{x_m, side * dice->Uniform(kBesideMin, kBesideMax)}};
  TivLandmark landmark;
  landmark.fate = fate;
  const bool two = fate == LandmarkFate::kKnownPlace || fate == LandmarkFate::kThirdPlace;
  landmark.modes = two ? 2 : 1;
  if (two) places.push_back(DrawPlace(options, places, dice));
  if (fate == LandmarkFate::kNewPlace || fate == LandmarkFate::kThirdPlace) {
    landmark.true_state = landmark.modes + 1;
    landmark.place = DrawPlace(options, places, dice);
  } else {
    landmark.true_state = landmark.modes;
    landmark.place = places.back() + options.sd_mode_m * dice->Normal2();
  }
  AddTivLandmark(options, landmark, places, kAbsentPrior, kSecondPrior, drive);
}

void DrawLandmarks(const ApproximationsDriveOptions& options,
                   ApproximationsDrive* drive,
                   Dice* dice) {
  std::vector<LandmarkFate> fates(std::begin(kFates), std::end(kFates));
  for (std::size_t i = fates.size(); i-- > 1;) {
    const auto other = static_cast<std::size_t>(dice->Uniform(0.0, static_cast<double>(i + 1)));
    std::swap(fates[i], fates[other]);
  }
  const double way = options.speed_mps * kTivScanPeriod * options.scans;
  const double spacing = (way - kFirstLandmark) / static_cast<double>(fates.size());
  for (std::size_t i = 0; i < fates.size(); ++i) {
    DrawLandmark(options, fates[i], kFirstLandmark + spacing * static_cast<double>(i), drive, dice);
  }
}

void Look(const ApproximationsDriveOptions& options,
          ApproximationsDrive* drive,
          Dice* dice,
          Dice* alarms) {
  const Se2 T_vehicle_map = drive->T_map_vehicle.back().Inverse();
  for (std::size_t g = 0; g < drive->landmarks.size(); ++g) {
    Observation observation;
    observation.signature = drive->map.groups[g].signature;
    observation.kind = Observation::Kind::kCartesian;
    const Eigen::Vector2d q = T_vehicle_map * drive->landmarks[g].place;
    const bool detected = dice->Coin(options.detection_probability);
    observation.z = q + options.sd_position_m * dice->Normal2();
    const bool seen = detected && q.norm() < options.max_range_m;
    if (!seen) {
      // A landmark that is seen hides the false alarms of its signature.
      const double area = M_PI * options.max_range_m * options.max_range_m;
      if (alarms == nullptr || !alarms->Coin(options.false_alarms_per_m2 * area)) continue;
      const double range = options.max_range_m * std::sqrt(alarms->Uniform(0.0, 1.0));
      const double bearing = alarms->Uniform(-M_PI, M_PI);
      observation.z = range * Eigen::Vector2d(std::cos(bearing), std::sin(bearing));
    }
    drive->scans.back().observations.push_back(observation);
  }
}

}  // namespace

Stamp TivScanStamp(int scan) { return StampFromSeconds(1000.0 + kTivScanPeriod * (scan + 1)); }

Status ApproximationsDriveOptions::Validate() const {
  if (scans < 1) return InvalidArgument("scans: {}, expected 1 or more", scans);
  for (const auto& [name, value] : {std::pair("speed_mps", speed_mps),
                                    std::pair("sd_start_m", sd_start_m),
                                    std::pair("sd_start_yaw_rad", sd_start_yaw_rad),
                                    std::pair("sd_mode_m", sd_mode_m),
                                    std::pair("sd_position_m", sd_position_m),
                                    std::pair("max_range_m", max_range_m),
                                    std::pair("false_alarms_per_m2", false_alarms_per_m2),
                                    std::pair("new_landmarks_per_m2", new_landmarks_per_m2),
                                    std::pair("shift_min_m", shift_min_m)}) {
    if (!(value > 0.0)) return InvalidArgument("{}: {}, expected > 0", name, value);
  }
  if (!(shift_max_m > 1.5 * shift_min_m)) {
    return InvalidArgument("shift_max_m: {}, expected more than half as much again as shift_min_m",
                           shift_max_m);
  }
  if (!(detection_probability > 0.0 && detection_probability < 1.0)) {
    return InvalidArgument("detection_probability: {}, expected within (0, 1)",
                           detection_probability);
  }
  return OkStatus();
}

Calibration TivCalibration(const ApproximationsDriveOptions& options) {
  Calibration calibration;
  calibration.odometry.sd_log_scale = kKnownScale;
  SensorCalibration& sensor = calibration.sensor;
  sensor.sd_position_m = options.sd_position_m;
  sensor.max_range_m = options.max_range_m;
  sensor.max_bearing_rad = M_PI;
  sensor.detection_probability = options.detection_probability;
  sensor.clutter_density_per_m2 = options.false_alarms_per_m2;
  sensor.new_landmark_density_per_m2 = options.new_landmarks_per_m2;
  return calibration;
}

void AddTivLandmark(const ApproximationsDriveOptions& options,
                    const TivLandmark& landmark,
                    const std::vector<Eigen::Vector2d>& places,
                    double absent_prior,
                    double second_prior,
                    ApproximationsDrive* drive) {
  const int index = static_cast<int>(drive->landmarks.size());
  drive->map.groups.push_back(
      MakeGroup(index, places, options.sd_mode_m, absent_prior, second_prior));
  drive->landmarks.push_back(landmark);
  std::vector<Eigen::Matrix2d> marginals;
  for (const LandmarkGroup& group : drive->map.groups) {
    for (const Mode& mode : group.modes) marginals.push_back(mode.cov_p_map_landmark);
  }
  drive->map.covariance = JointCovariance(marginals, {});
}

void DriveTiv(const ApproximationsDriveOptions& options,
              Se2 T_map_vehicle,
              double yaw_rate_radps,
              ApproximationsDrive* drive,
              Dice* dice,
              Dice* alarms) {
  const Eigen::Vector3d twist(options.speed_mps, 0.0, yaw_rate_radps);
  for (int scan = 0; scan < options.scans; ++scan) {
    MotionIncrement motion;
    motion.T_begin_end = Se2::Exp(kTivScanPeriod * twist);
    motion.cov = options.sd_motion.cwiseAbs2().asDiagonal();
    T_map_vehicle = T_map_vehicle * motion.T_begin_end * Se2::Exp(dice->Normal3(motion.cov));
    drive->motions.push_back(motion);
    drive->T_map_vehicle.push_back(T_map_vehicle);
    drive->scans.emplace_back().stamp = TivScanStamp(scan);
    Look(options, drive, dice, alarms);
  }
}

ApproximationsDrive SimulateApproximationsDrive(const ApproximationsDriveOptions& options,
                                                std::uint64_t seed,
                                                bool false_alarms) {
  Dice dice(seed);
  Dice alarms(seed ^ kFalseAlarmSeed);
  ApproximationsDrive drive;
  drive.map.calibration = TivCalibration(options);
  drive.map.stamp = TivScanStamp(-1);
  DrawLandmarks(options, &drive, &dice);
  const Eigen::Vector3d sd(options.sd_start_m, options.sd_start_m, options.sd_start_yaw_rad);
  drive.start.cov_T_map_vehicle = sd.cwiseAbs2().asDiagonal();
  const Se2 T_map_vehicle = Se2::Exp(dice.Normal3(drive.start.cov_T_map_vehicle));
  const double yaw_rate = dice.Uniform(-kMaxYawRate, kMaxYawRate);
  DriveTiv(options, T_map_vehicle, yaw_rate, &drive, &dice, false_alarms ? &alarms : nullptr);
  return drive;
}

}  // namespace shiftmap
