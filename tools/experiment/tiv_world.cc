// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/tiv_world.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <utility>

#include "mapstore/core/day.h"

namespace shiftmap {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;
constexpr double kIdealSd = 0.1;         // Of a coordinate of a corner. [m]
constexpr double kIdealDetection = 0.8;  // Of a corner.
constexpr double kReach = 20.0;          // [m]
constexpr int kTags = 40;
constexpr std::size_t kViewBeams = 360;

// From a drive to the next, and the rate at which a landmark of one mode has left it by then with
// 0.1: 1/2 + 1/2 exp(-2 λ Δt) = 0.9, Π of T-IV IX-E. [1/s]
const double kLeaveRate = -0.5 * std::log(0.8) / kSecondsPerDay;

// The beam of such a lidar towards a point in the vehicle frame.
std::size_t BeamTowards(const LidarScan& view, const Eigen::Vector2d& q) {
  constexpr double kStep = 2.0 * std::numbers::pi / kViewBeams;
  const double from_first = std::atan2(q.y(), q.x()) + 0.5 * view.sensor.field_of_view_rad;
  return static_cast<std::size_t>(
      std::clamp(std::lround(from_first / kStep), 0L, static_cast<long>(kViewBeams) - 1));
}

// One lidar at the vehicle's origin that covers what several do.
LidarScan Combined(const std::vector<SimulatedLidar>& lidars,
                   const std::vector<LidarRanges>& ranges,
                   Stamp stamp) {
  LidarScan view;
  view.stamp = stamp;
  view.sensor.field_of_view_rad =
      2.0 * std::numbers::pi * static_cast<double>(kViewBeams - 1) / kViewBeams;
  view.ranges_m.assign(kViewBeams, 0.0F);
  for (const LidarRanges& scan : ranges) {
    const LidarSensor& sensor = lidars[scan.lidar].sensor;
    for (std::size_t beam = 0; beam < scan.ranges_m.size(); ++beam) {
      const double range = scan.ranges_m[beam];
      if (!sensor.Returned(range)) continue;
      const double bearing = sensor.Bearing(beam, scan.ranges_m.size());
      const Eigen::Vector2d q = sensor.T_vehicle_lidar * Eigen::Vector2d(range * std::cos(bearing),
                                                                         range * std::sin(bearing));
      float& covered_m = view.ranges_m[BeamTowards(view, q)];
      covered_m = std::max(covered_m, static_cast<float>(q.norm()));
    }
  }
  // A direction that no beam hit is covered as far as the one before it.
  for (std::size_t i = 1; i < kViewBeams; ++i) {
    if (view.ranges_m[i] == 0.0F) view.ranges_m[i] = view.ranges_m[i - 1];
  }
  return view;
}

bool Covers(const LidarScan& view, const Eigen::Vector2d& q) {
  constexpr double kGrown = 0.5;
  return q.norm() < std::min<double>(view.ranges_m[BeamTowards(view, q)] + kGrown, kReach);
}

// The corners of the version in view, with Gaussian noise.
void AddCorners(const MineSite& site,
                PlanVersion version,
                const Se2& truth,
                const LidarScan& view,
                std::mt19937_64* random,
                Scan* scan) {
  std::normal_distribution<double> noise(0.0, kIdealSd);
  std::bernoulli_distribution detected(kIdealDetection);
  const std::size_t first = site.barriers.size();
  for (std::size_t c = 0; c < site.corners; ++c) {
    const SimulatedGroup& group = site.groups[first + c];
    const Eigen::Vector2d p = group.modes[version == PlanVersion::kOriginal ? 0 : 1];
    const Eigen::Vector2d q = truth.Inverse() * p;
    const bool seen = detected(*random);
    const Eigen::Vector2d error(noise(*random), noise(*random));
    if (!seen || !Covers(view, q)) continue;
    Observation observation;
    observation.signature = group.signature;
    observation.kind = Observation::Kind::kCartesian;
    observation.z = q + error;
    scan->observations.push_back(observation);
  }
}

void SetNoise(const TivOptions& options,
              const MineDriveOptions& drive,
              Calibration* calibration,
              Eigen::Matrix3d* Q) {
  const double T = 1.0 / drive.odometry_rate_hz;
  if (options.noise == TivNoise::kPrinted) {
    *Q = 0.05 * Eigen::Vector3d(0.05, 0.05, std::pow(5.0 * kDegree, 2)).asDiagonal();
    calibration->sensor.sd_position_m = 0.5;
  } else {
    const double slip = 1e-4;  // Keeps Q positive across the heading, which (30) does not disturb.
    const double v = std::pow(drive.odometry_noise.sd_v_mps * T, 2);
    const double omega = std::pow(drive.odometry_noise.sd_omega_radps * T, 2);
    *Q = Eigen::Vector3d(v, options.euler ? v : slip * v, omega).asDiagonal();
    calibration->sensor.sd_position_m = kIdealSd;
  }
}

Calibration MakeCalibration(const TivOptions& options) {
  Calibration calibration;
  calibration.odometry.sd_log_scale = 0.0;
  SensorCalibration& sensor = calibration.sensor;
  sensor.max_range_m = kReach;
  sensor.max_bearing_rad = std::numbers::pi;
  sensor.detection_probability = options.noise == TivNoise::kIdeal ? kIdealDetection : 0.5;
  sensor.sd_range_m = 0.1;
  sensor.sd_bearing_rad = 0.02;
  sensor.clutter_density_per_m2 = 3.5e-7;  // T-IV IX-E.
  sensor.new_landmark_density_per_m2 = 3.5e-7;
  return calibration;
}

MineDriveOptions MakeDrive(const TivOptions& options) {
  MineDriveOptions drive;
  drive.driver.legs = 1;
  drive.driver.from_end = true;
  drive.scan_rate_hz = options.scan_rate_hz;
  drive.odometry.noise_v = 0.0;
  drive.odometry.noise_omega = 0.0;
  drive.odometry_noise = kTIvOdometryNoise;
  drive.tag_sensor.max_bearing_rad = std::numbers::pi;
  drive.lidars = FrontAndRearLidar();
  drive.points = options.noise != TivNoise::kIdeal;
  drive.front_end.points.edges = false;
  // As the points of these walls scatter about their corners.
  drive.front_end.sd_place_m = 0.03;
  drive.front_end.sd_range_m = 0.02;
  drive.front_end.sd_bearing_rad = 0.005;
  return drive;
}

}  // namespace

StatusOr<TivWorld> TivWorld::Make(const TivOptions& options) {
  TivWorld world;
  world.options_ = options;
  MinePlanOptions plan_options;
  plan_options.seed = options.seed;
  plan_options.length_m = options.length_m;
  plan_options.crosscuts = 1;
  plan_options.drawpoints = std::max(2, static_cast<int>(options.length_m / 20.0));
  SHIFTMAP_ASSIGN_OR_RETURN(MinePlan plan, GenerateMinePlan(plan_options));
  MineLandmarkOptions landmarks;
  landmarks.seed = options.seed;
  landmarks.corners = true;
  landmarks.tags = options.noise == TivNoise::kIdeal ? kTags : 0;
  landmarks.places_per_tag = 1;
  SHIFTMAP_ASSIGN_OR_RETURN(world.site_, MakeMineSite(std::move(plan), landmarks));
  world.drive_ = MakeDrive(options);
  world.calibration_ = MakeCalibration(options);
  SetNoise(options, world.drive_, &world.calibration_, &world.Q_);
  world.tree_.alpha = 1e-8;  // T-IV IX-E, as what follows.
  world.tree_.gate_probability = 0.99;
  world.tree_.errors = options.errors;
  world.tree_.leave_rate_per_s = kLeaveRate;
  world.tree_.field_of_view.model = FieldOfViewModel::kScanPolygon;

  SHIFTMAP_ASSIGN_OR_RETURN(world.mapped_, world.MapOriginal(options.seed));
  return world;
}

StatusOr<TreeSlam> TivWorld::MapOriginal(std::uint64_t seed) const {
  SHIFTMAP_ASSIGN_OR_RETURN(const TivDrive drive, Simulate(PlanVersion::kOriginal, seed, 0));
  TreeSlam slam(tree_, calibration_, std::nullopt);
  Filter(*this, drive, {drive.steps.front().truth, Eigen::Matrix3d::Zero()}, &slam);
  if (slam.Content().groups.empty()) {
    return InvalidArgument("seed {}: no moved corner is seen, try another", seed);
  }
  return slam;
}

TivWorld TivWorld::WithMap(TreeSlam mapped) const {
  TivWorld world = *this;
  world.mapped_ = std::move(mapped);
  return world;
}

StatusOr<TivDrive> TivWorld::Simulate(PlanVersion version, std::uint64_t seed, int day) const {
  std::vector<ModeNumber> modes(site_.groups.size(), kAbsent);
  modes = site_.WithCornersOf(version, std::move(modes));
  for (std::size_t g = site_.barriers.size() + site_.corners; g < modes.size(); ++g) {
    modes[g] = ModeNumber(1);
  }
  MineDriveOptions of_day = drive_;
  of_day.start = drive_.start + FromSeconds(kSecondsPerDay * day);
  SHIFTMAP_ASSIGN_OR_RETURN(const SimulatedDrive simulated,
                            SimulateDrive(site_, version, modes, of_day, seed));
  std::mt19937_64 random(seed);
  TivDrive drive;
  drive.odometry_period_s = 1.0 / drive_.odometry_rate_hz;
  const Run& run = simulated.simulated.run;
  std::size_t sample = 0;
  std::size_t range = 0;
  for (const Scan& scan : run.scans) {
    TivDrive::Step step;
    for (; sample < run.odometry.size() && run.odometry[sample].stamp < scan.stamp; ++sample) {
      step.odometry.push_back(run.odometry[sample]);
    }
    std::vector<LidarRanges> ranges;
    for (; range < simulated.ranges.size() && simulated.ranges[range].stamp <= scan.stamp;
         ++range) {
      ranges.push_back(simulated.ranges[range]);
    }
    step.truth = simulated.simulated.truth[sample].T_map_vehicle;
    step.view = Combined(drive_.lidars, ranges, scan.stamp);
    step.scan = scan;
    for (Observation& observation : step.scan.observations) {
      if (options_.noise == TivNoise::kPrinted) observation.cov_z.reset();
      if (options_.noise == TivNoise::kIdeal) observation.signature = {};
    }
    if (options_.noise == TivNoise::kIdeal) {
      AddCorners(site_, version, step.truth, step.view, &random, &step.scan);
    }
    drive.steps.push_back(std::move(step));
  }
  return drive;
}

PoseWithCovariance TivWorld::Start(const Se2& truth, std::uint64_t seed) const {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  const Eigen::Vector3d sd(options_.start_sd_m, options_.start_sd_m, options_.start_sd_rad);
  const Eigen::Vector3d error(normal(random), normal(random), normal(random));
  return {truth * Se2::Exp(sd.cwiseProduct(error)), sd.cwiseAbs2().asDiagonal()};
}

std::optional<Eigen::Vector2d> TivWorld::Corner(const Signature& signature,
                                                PlanVersion version) const {
  for (std::size_t c = 0; c < site_.corners; ++c) {
    const SimulatedGroup& group = site_.groups[site_.barriers.size() + c];
    if (group.signature == signature) {
      return group.modes[version == PlanVersion::kOriginal ? 0 : 1];
    }
  }
  return std::nullopt;
}

namespace {

// The exact arcs of a step, with Q along the vehicle's axes.
MotionIncrement Arcs(const TivWorld& world, const TivDrive& drive, const TivDrive::Step& step) {
  MotionIncrement motion;
  for (const OdometrySample& sample : step.odometry) {
    const Se2 arc =
        Se2::Exp(Eigen::Vector3d(sample.v_mps, 0.0, sample.omega_radps) * drive.odometry_period_s);
    const Eigen::Matrix3d A = arc.InverseAdjoint();
    motion.cov = A * motion.cov * A.transpose() + world.Q();
    motion.T_begin_end = motion.T_begin_end * arc;
  }
  return motion;
}

}  // namespace

void Filter(const TivWorld& world,
            const TivDrive& drive,
            const TivDrive::Step& step,
            TreeSlam* slam) {
  if (world.options().euler) {
    for (const OdometrySample& sample : step.odometry) {
      slam->PredictEuler(sample.v_mps, sample.omega_radps, drive.odometry_period_s, world.Q());
    }
  } else {
    slam->Predict(Arcs(world, drive, step));
  }
  const LidarView view{true, step.view, Se2()};
  slam->Correct(step.scan, &view);
}

void Filter(const TivWorld& world,
            const TivDrive& drive,
            const PoseWithCovariance& start,
            TreeSlam* slam) {
  slam->BeginRun(start, world.calibration(), drive.steps.front().scan.stamp);
  for (const TivDrive::Step& step : drive.steps) Filter(world, drive, step, slam);
  slam->EndRun();
}

void Predict(const TivWorld& world,
             const TivDrive& drive,
             const TivDrive::Step& step,
             SlamState* state) {
  if (!world.options().euler) {
    state->Predict(Arcs(world, drive, step));
    return;
  }
  for (const OdometrySample& sample : step.odometry) {
    state->Predict(EulerStep(
        state->pose(), sample.v_mps, sample.omega_radps, drive.odometry_period_s, world.Q()));
  }
}

}  // namespace shiftmap
