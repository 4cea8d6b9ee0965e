// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/mine_drive.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "tools/sim/landmark_sensor.h"
#include "tools/sim/mode_changes.h"
#include "tools/sim/option_checks.h"
#include "tools/sim/random.h"

namespace shiftmap {
namespace {

enum Stream { kMotion, kOdometry, kTags, kLidars };

// A point gets the signature of a corner of the site within this of the corner's true place, in x
// and in y, by the true pose; the nearest one if there are several. T-IV IX-B takes boxes drawn by
// hand. [m]
constexpr double kCornerBoxM = 0.5;

class DriveSimulator {
 public:
  DriveSimulator(const MineSite& site,
                 PlanVersion version,
                 std::vector<ModeNumber> active_mode,
                 const MineDriveOptions& options,
                 std::uint64_t seed)
      : site_(site),
        options_(options),
        walls_(site.WallsOf(version, active_mode)),
        motion_(MakeRandom(seed, kMotion)),
        odometry_(MakeRandom(seed, kOdometry)),
        tags_(MakeRandom(seed, kTags)),
        lidars_(MakeRandom(seed, kLidars)) {
    drive_.simulated.active_mode = std::move(active_mode);
    tagged_ = drive_.simulated.active_mode;
    const auto first = static_cast<std::ptrdiff_t>(site.barriers.size());
    std::fill_n(tagged_.begin() + first, site.corners, kAbsent);
    for (const SimulatedLidar& lidar : options.lidars) {
      front_ends_.push_back(options.front_end);
      front_ends_.back().sensor = lidar.sensor;
    }
  }

  SimulatedDrive Drive(const std::vector<Eigen::Vector2d>& path) {
    PathDriver driver(path, options_.driver, options_.loader);
    Loader loader(options_.loader);
    const double tick_s = 1.0 / options_.odometry_rate_hz;
    const auto ticks = static_cast<std::int64_t>(options_.max_duration_s / tick_s);
    const auto scan_every =
        std::max(1LL, std::llround(options_.odometry_rate_hz / options_.scan_rate_hz));
    StampedPose pose{options_.start, driver.Start()};
    for (std::int64_t tick = 0; tick <= ticks; ++tick) {
      pose.stamp = options_.start + FromSeconds(static_cast<double>(tick) * tick_s);
      const std::optional<LoaderCommand> command = driver.Drive(pose.T_map_vehicle, loader.v_mps());
      if (!command) break;
      drive_.simulated.truth.push_back(pose);
      drive_.articulation_rad.push_back(loader.articulation_rad());
      if (tick % scan_every == 0) TakeScan(pose);
      LogOdometry(pose.stamp, loader.Step(*command, tick_s));
      pose.T_map_vehicle =
          pose.T_map_vehicle * TrueMotion(Lagged(tick_s), tick_s, options_.odometry, &motion_);
    }
    return std::move(drive_);
  }

 private:
  void LogOdometry(Stamp stamp, const Velocity& velocity) {
    const VelocityNoise& noise = options_.odometry_noise;
    OdometrySample sample{stamp, velocity.v_mps, velocity.omega_radps};
    drive_.true_odometry.push_back(sample);
    sample.v_mps += Gaussian(noise.sd_v_mps, &odometry_);
    sample.omega_radps += Gaussian(noise.sd_omega_radps, &odometry_);
    drive_.simulated.run.odometry.push_back(sample);
  }

  Velocity Lagged(double tick_s) const {
    const auto lag = static_cast<std::size_t>(std::lround(options_.odometry.lag_s / tick_s));
    const std::size_t last = drive_.true_odometry.size() - 1;
    const OdometrySample& sample = drive_.true_odometry[last - std::min(lag, last)];
    return {sample.v_mps, sample.omega_radps};
  }

  void TakeScan(const StampedPose& pose) {
    const InSight in_sight = [&](const Eigen::Vector2d& p) {
      return walls_.InSight(pose.T_map_vehicle.translation(), p);
    };
    Scan scan = SenseLandmarks(site_.groups,
                               tagged_,
                               pose,
                               options_.tag_sensor,
                               options_.clutter_per_scan,
                               in_sight,
                               &tags_);
    const std::size_t first_point = scan.observations.size();
    for (std::size_t i = 0; i < options_.lidars.size(); ++i) ScanWith(i, pose, &scan);
    SignCorners(pose.T_map_vehicle, first_point, &scan);
    drive_.simulated.run.scans.push_back(std::move(scan));
  }

  void ScanWith(std::size_t index, const StampedPose& pose, Scan* scan) {
    const SimulatedLidar& lidar = options_.lidars[index];
    LidarRanges& taken = drive_.ranges.emplace_back();
    taken.stamp = pose.stamp;
    taken.lidar = index;
    taken.ranges_m.resize(static_cast<std::size_t>(lidar.beams));
    TakeRanges(walls_, lidar, pose.T_map_vehicle, &lidars_, taken.ranges_m);
    if (options_.log_scans && index == 0) {
      drive_.simulated.run.lidar_scans.push_back(
          {pose.stamp, lidar.sensor, {taken.ranges_m.begin(), taken.ranges_m.end()}});
    }
    if (!options_.points) return;
    Scan points = ObserveInterestPoints(pose.stamp, taken.ranges_m, front_ends_[index]);
    scan->observations.insert(scan->observations.end(),
                              std::make_move_iterator(points.observations.begin()),
                              std::make_move_iterator(points.observations.end()));
  }

  void SignCorners(const Se2& T_map_vehicle, std::size_t first_point, Scan* scan) const {
    for (std::size_t c = 0; c < site_.corners; ++c) {
      const std::size_t g = site_.barriers.size() + c;
      const auto mode = static_cast<std::size_t>(drive_.simulated.active_mode[g].value() - 1);
      const Eigen::Vector2d& corner = site_.groups[g].modes[mode];
      Observation* nearest = nullptr;
      double least = kCornerBoxM;
      for (std::size_t i = first_point; i < scan->observations.size(); ++i) {
        const Eigen::Vector2d p = T_map_vehicle * scan->observations[i].z;
        const double distance = (p - corner).lpNorm<Eigen::Infinity>();
        if (distance > least) continue;
        least = distance;
        nearest = &scan->observations[i];
      }
      if (nearest != nullptr) nearest->signature = site_.groups[g].signature;
    }
  }

  const MineSite& site_;
  const MineDriveOptions& options_;
  RayCaster walls_;
  Random motion_;
  Random odometry_;
  Random tags_;
  Random lidars_;
  std::vector<ModeNumber> tagged_;  // Active modes, without the corners, which have no tag.
  std::vector<LidarFrontEndOptions> front_ends_;  // By lidar.
  SimulatedDrive drive_;
};

}  // namespace

Status MineDriveOptions::Validate() const {
  SHIFTMAP_RETURN_IF_ERROR(loader.Validate());
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("speed", driver.speed_mps));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("legs", driver.legs));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("longest drive", max_duration_s));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("odometry rate", odometry_rate_hz));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("scan rate", scan_rate_hz));
  SHIFTMAP_RETURN_IF_ERROR(CheckOdometry(odometry));
  SHIFTMAP_RETURN_IF_ERROR(CheckNotNegative("odometry white noise of v", odometry_noise.sd_v_mps));
  SHIFTMAP_RETURN_IF_ERROR(
      CheckNotNegative("odometry white noise of omega", odometry_noise.sd_omega_radps));
  SHIFTMAP_RETURN_IF_ERROR(CheckLandmarkSensor(tag_sensor));
  SHIFTMAP_RETURN_IF_ERROR(CheckNotNegative("clutter per scan", clutter_per_scan));
  for (const SimulatedLidar& lidar : lidars) SHIFTMAP_RETURN_IF_ERROR(lidar.Validate());
  return front_end.Validate();
}

Status CheckPath(const std::vector<Eigen::Vector2d>& path, const std::vector<Wall>& rock) {
  if (path.size() < 2) {
    return InvalidArgument("world: a path of {} points, expected 2 or more", path.size());
  }
  const RayCaster walls(rock);
  for (std::size_t i = 0; i + 1 < path.size(); ++i) {
    const Eigen::Vector2d& a = path[i];
    const Eigen::Vector2d& b = path[i + 1];
    if (a.allFinite() && b.allFinite() && a != b && walls.InSight(a, b)) continue;
    return InvalidArgument(
        "world: the path from ({:.1f}, {:.1f}) to ({:.1f}, {:.1f}) crosses a wall or has no length",
        a.x(),
        a.y(),
        b.x(),
        b.y());
  }
  return OkStatus();
}

std::vector<SimulatedLidar> FrontAndRearLidar() {
  std::vector<SimulatedLidar> lidars(2);
  lidars[0].sensor.T_vehicle_lidar = Se2(1.5, 0.0, 0.0);
  lidars[1].sensor.T_vehicle_lidar = Se2(-1.5, 0.0, std::numbers::pi);
  return lidars;
}

StatusOr<SimulatedDrive> SimulateDrive(const MineSite& site,
                                       PlanVersion version,
                                       const std::vector<ModeNumber>& active_mode,
                                       const MineDriveOptions& options,
                                       std::uint64_t seed) {
  SHIFTMAP_RETURN_IF_ERROR(options.Validate());
  const std::vector<ModeNumber> states[] = {active_mode};
  SHIFTMAP_RETURN_IF_ERROR(CheckStates(states, site.ModeCounts(), 1));
  const std::vector<Eigen::Vector2d>& path = options.path.empty() ? site.plan.path : options.path;
  SHIFTMAP_RETURN_IF_ERROR(CheckPath(path, site.plan.walls(version)));
  if (site.groups.empty() && options.clutter_per_scan > 0.0) {
    return InvalidArgument("world: clutter needs a landmark whose signature it has");
  }
  DriveSimulator simulator(site, version, site.WithCornersOf(version, active_mode), options, seed);
  return simulator.Drive(path);
}

}  // namespace shiftmap
