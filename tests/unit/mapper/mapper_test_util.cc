// SPDX-License-Identifier: Apache-2.0
#include "tests/unit/mapper/mapper_test_util.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <set>

#include "mapper/covariance/gauge.h"
#include "mapstore/geometry/covariance.h"
#include "proto/core/check.h"
#include "tools/sim/landmark_sensor.h"
#include "tools/sim/odometry_motion.h"
#include "tools/sim/random.h"

namespace shiftmap::testing {

OpenWorldOptions SmallWorld(std::uint64_t seed) {
  OpenWorldOptions options;
  options.seed = seed;
  options.groups = 12;
  options.size_m = 14.0;
  options.mode_gap_m = 1.5;
  options.duration_s = 120.0;
  options.odometry_rate_hz = 10.0;
  options.scan_rate_hz = 2.5;
  options.speed_mps = 1.0;
  options.sensor.max_range_m = 8.0;
  return options;
}

SimulatedWorld StaticWorld(std::uint64_t seed) {
  OpenWorldOptions options = SmallWorld(seed);
  options.runs = 1;
  options.modes_per_group = 1;
  options.duration_s = 200.0;
  return Simulate(options);
}

namespace {

// The mode of each landmark in a run at a tick of it.
using ModesAt = std::function<std::vector<ModeNumber>(int run, int tick)>;

// On a square floor from the origin on. [m]
Eigen::Vector2d Anywhere(double size, Random* random) {
  const double x = Uniform(0.0, size, random);
  return {x, Uniform(0.0, size, random)};
}

constexpr double kTick = 0.1;

// Ticks at which a vehicle stands.
struct Stand {
  int first = 0;
  int last = 0;
};

// Runs that each drive along `way` for a time, from the origin on, and round again.
void AddRuns(const std::vector<Eigen::Vector2d>& way,
             int ticks,
             int runs,
             const OdometryCalibration& odometry,
             const ModesAt& modes_at,
             Random* random,
             SimulatedWorld* world,
             const Stand& stand = {}) {
  constexpr int kTicksPerScan = 2;
  const SensorCalibration sensor{
      .sd_range_m = 0.1, .sd_bearing_rad = 0.02, .detection_probability = 0.8};
  for (int r = 0; r < runs; ++r) {
    SimulatedRun& simulated = world->runs.emplace_back();
    simulated.active_mode = modes_at(r, 0);
    simulated.run.info.vehicle = "v";
    const Stamp begin = StampFromSeconds(1.7676e9 + r * kSecondsPerDay);
    Se2 T_map_vehicle;
    std::size_t next = 0;
    for (int tick = 0; tick < ticks; ++tick) {
      const Stamp stamp = begin + FromSeconds(tick * kTick);
      simulated.truth.push_back({stamp, T_map_vehicle});
      Eigen::Vector2d to = T_map_vehicle.Inverse() * way[next % way.size()];
      if (to.norm() < 1.0) to = T_map_vehicle.Inverse() * way[++next % way.size()];
      const double turn = std::atan2(to.y(), to.x());
      Velocity logged{1.5 * std::max(0.15, 1.0 - std::abs(turn)), std::clamp(turn, -0.8, 0.8)};
      const bool stands = stand.first <= tick && tick < stand.last;
      if (stands) logged = {};
      simulated.run.odometry.push_back({stamp, logged.v_mps, logged.omega_radps});
      if (tick % kTicksPerScan == 0) {
        simulated.run.scans.push_back(SenseLandmarks(
            world->groups, modes_at(r, tick), simulated.truth.back(), sensor, 0.0, {}, random));
      }
      if (!stands) T_map_vehicle = T_map_vehicle * TrueMotion(logged, kTick, odometry, random);
    }
  }
}

}  // namespace

SimulatedWorld TwoHalls(std::uint64_t seed,
                        int runs,
                        const OdometryCalibration& odometry,
                        int moved) {
  constexpr double kWay = 200.0;
  constexpr int kTicks = 4500;
  Random random = MakeRandom(seed, 0);
  SimulatedWorld world;
  for (int i = 0; i < 16; ++i) {
    const double x = Uniform(0.0, 12.0, &random) + (i < 8 ? 0.0 : kWay);
    world.groups.push_back(
        {Signature(fmt::format("{:02}", i)), {{x, Uniform(-6.0, 8.0, &random)}}});
  }
  const std::vector<Eigen::Vector2d> way = {
      {10.0, 2.0}, {kWay, 1.0}, {kWay + 11.0, 3.0}, {kWay + 9.0, -3.0}, {10.0, -1.0}, {0.0, 0.0}};
  for (std::size_t i = 8; i < 8 + static_cast<std::size_t>(moved); ++i) {
    std::vector<Eigen::Vector2d>& modes = world.groups[i].modes;
    modes.emplace_back(modes.front() + Eigen::Vector2d(0.6, 0.8));
  }
  // Those that move are at their other place in the last run.
  const ModesAt moved_at_last = [&](int run, int) {
    std::vector<ModeNumber> modes;
    for (const SimulatedGroup& group : world.groups) {
      modes.emplace_back(run + 1 == runs ? std::ssize(group.modes) : 1);
    }
    return modes;
  };
  AddRuns(way, kTicks, runs, odometry, moved_at_last, &random, &world);
  return world;
}

SimulatedWorld LongLoop(std::uint64_t seed) {
  constexpr double kSide = 100.0;
  constexpr double kSpacing = 8.0;
  constexpr int kTicks = 2900;
  const std::vector<Se2> sides = {{0.0, 0.0, 0.0},
                                  {kSide, 0.0, 0.5 * std::numbers::pi},
                                  {kSide, kSide, std::numbers::pi},
                                  {0.0, kSide, -0.5 * std::numbers::pi}};
  Random random = MakeRandom(seed, 0);
  SimulatedWorld world;
  for (const Se2& T_map_side : sides) {
    for (double s = 0.0; s < kSide; s += kSpacing) {
      const Eigen::Vector2d p(s + Uniform(0.0, kSpacing, &random), Uniform(-4.0, 4.0, &random));
      world.groups.push_back(
          {Signature(fmt::format("{:02}", world.groups.size())), {T_map_side * p}});
    }
  }
  const std::vector<Eigen::Vector2d> way = {
      {kSide, 0.0}, {kSide, kSide}, {0.0, kSide}, {0.0, 0.0}, {kSide, 1.0}};
  AddRuns(
      way,
      kTicks,
      1,
      {.noise_v = 0.01, .noise_omega = 0.01},
      [&](int, int) { return std::vector<ModeNumber>(world.groups.size(), ModeNumber(1)); },
      &random,
      &world);
  return world;
}

SimulatedWorld LongStand(std::uint64_t seed, double stand_s) {
  constexpr double kSize = 20.0;
  constexpr int kTicks = 3000;
  Random random = MakeRandom(seed, 0);
  SimulatedWorld world;
  for (int i = 0; i < 14; ++i) {
    world.groups.push_back({Signature(fmt::format("{:02}", i)), {Anywhere(kSize, &random)}});
  }
  std::vector<Eigen::Vector2d> way;
  for (int i = 0; i < 40; ++i) way.push_back(Anywhere(kSize, &random));
  const int stands = static_cast<int>(stand_s / kTick);
  AddRuns(way,
          kTicks + stands,
          1,
          {.noise_v = 0.02, .noise_omega = 0.02},
          [&](int, int) { return std::vector<ModeNumber>(world.groups.size(), ModeNumber(1)); },
          &random,
          &world,
          {kTicks / 2, kTicks / 2 + stands});
  return world;
}

SimulatedWorld Doors(std::uint64_t seed, int runs) {
  constexpr double kSize = 30.0;
  constexpr double kGap = 0.8;
  constexpr int kDoors = 6;
  constexpr int kLandmarks = 22;
  constexpr int kWaypoints = 40;
  constexpr int kTicks = 9000;
  Random random = MakeRandom(seed, 0);
  SimulatedWorld world;
  for (int i = 0; i < kLandmarks; ++i) {
    const Eigen::Vector2d p = Anywhere(kSize, &random);
    world.groups.push_back({Signature(fmt::format("{:02}", i)), {p}});
    if (i < kDoors) world.groups.back().modes.emplace_back(p.x() + kGap, p.y());
  }
  std::vector<Eigen::Vector2d> way;
  for (int i = 0; i < kWaypoints; ++i) way.push_back(Anywhere(kSize, &random));
  // Each changes its place in turn, at a time of its own.
  const ModesAt to_and_fro = [&](int, int tick) {
    constexpr int kTicksAtMode = 2000;
    constexpr int kTicksBetweenGroups = 370;
    std::vector<ModeNumber> modes;
    for (const SimulatedGroup& group : world.groups) {
      const int of_group = tick + kTicksBetweenGroups * static_cast<int>(modes.size());
      modes.emplace_back(of_group / kTicksAtMode % static_cast<int>(group.modes.size()) + 1);
    }
    return modes;
  };
  AddRuns(way, kTicks, runs, {.noise_v = 0.01, .noise_omega = 0.01}, to_and_fro, &random, &world);
  return world;
}

MapContent SurveyOf(const SimulatedWorld& world, double sd_m) {
  constexpr double kAway = 0.1;
  const Eigen::Matrix2d cov = sd_m * sd_m * Eigen::Matrix2d::Identity();
  MapContent survey;
  std::vector<Eigen::Matrix2d> covariances;
  for (const SimulatedGroup& simulated : world.groups) {
    const auto modes = static_cast<int>(simulated.modes.size());
    LandmarkGroup group;
    group.signature = simulated.signature;
    group.chain = ModeChain::Uniform(modes, 1e-5);
    group.probabilities = Eigen::VectorXd::Constant(modes + 1, (1.0 - kAway) / modes);
    group.probabilities[0] = kAway;
    for (int m = 0; m < modes; ++m) {
      group.modes.push_back(
          {ModeNumber(m + 1), simulated.modes[static_cast<std::size_t>(m)], cov, Stamp()});
      covariances.push_back(cov);
    }
    survey.groups.push_back(std::move(group));
  }
  survey.covariance = JointCovariance(std::move(covariances), {});
  return survey;
}

std::size_t CountModes(const BuildState& build) {
  std::size_t count = 0;
  for (const std::vector<BuildMode>& group : build.modes) count += group.size();
  return count;
}

SimulatedWorld Simulate(const OpenWorldOptions& options) {
  StatusOr<SimulatedWorld> world = SimulateOpen(options);
  SHIFTMAP_CHECK(world.ok(), "{}", Message(world.status()));
  return *std::move(world);
}

std::vector<MapperInput> Inputs(const SimulatedWorld& world) {
  std::vector<MapperInput> inputs;
  for (std::size_t i = 0; i < world.runs.size(); ++i) {
    inputs.push_back({fmt::format("run-{}", i), fmt::format("{:064x}", i), world.runs[i].run});
  }
  return inputs;
}

SimulatedRun CarriedMeanwhile(SimulatedRun run, Stamp begin, Stamp end) {
  const auto cut = [&](auto* items) {
    std::erase_if(*items,
                  [&](const auto& item) { return begin <= item.stamp && item.stamp < end; });
    for (auto& item : *items) {
      if (item.stamp >= end) item.stamp -= end - begin;
    }
  };
  cut(&run.run.odometry);
  cut(&run.run.scans);
  cut(&run.truth);
  return run;
}

std::vector<Signature> SignaturesOf(const SimulatedWorld& world) {
  std::vector<Signature> signatures;
  for (const SimulatedGroup& group : world.groups) signatures.push_back(group.signature);
  return signatures;
}

MappingRun Arrange(const SimulatedWorld& world, const Run& run) {
  return MakeMappingRun(run, SignaturesOf(world), FrontEndOptions());
}

std::vector<Se2> TruePoses(const SimulatedRun& simulated, const MappingRun& run) {
  std::vector<Se2> poses;
  auto at = simulated.truth.begin();
  for (const KeyFrame& frame : run.frames) {
    at = std::find_if(at, simulated.truth.end(), [&](const StampedPose& pose) {
      return pose.stamp == frame.stamp;
    });
    SHIFTMAP_CHECK(at != simulated.truth.end(), "a key frame has no true pose");
    poses.push_back(at->T_map_vehicle);
  }
  return poses;
}

double AlignedRmse(const std::vector<Se2>& estimate, const std::vector<Se2>& truth) {
  std::vector<PointPair> pairs;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    pairs.push_back({truth[i].translation(), estimate[i].translation()});
  }
  const StatusOr<Se2> T_truth_estimate = AlignRigid2d(pairs);
  SHIFTMAP_CHECK(T_truth_estimate.ok(), "{}", Message(T_truth_estimate.status()));
  double squares = 0.0;
  for (const PointPair& pair : pairs) {
    squares += (pair.p_a - *T_truth_estimate * pair.p_b).squaredNorm();
  }
  return std::sqrt(squares / static_cast<double>(pairs.size()));
}

std::vector<std::vector<ModeNumber>> VisitedModes(const SimulatedWorld& world, int min_sightings) {
  std::vector<std::set<ModeNumber>> visited(world.groups.size());
  for (const SimulatedRun& simulated : world.runs) {
    const MappingRun run = Arrange(world, simulated.run);
    for (const MappingVisit& visit : run.visits) {
      const auto group = static_cast<std::size_t>(visit.group.value());
      if (std::ssize(visit.sightings) < min_sightings) continue;
      visited[group].insert(simulated.active_mode[group]);
    }
  }
  std::vector<std::vector<ModeNumber>> result;
  for (const std::set<ModeNumber>& modes : visited) result.emplace_back(modes.begin(), modes.end());
  return result;
}

std::vector<MatchedMode> MatchModes(const MapContent& content,
                                    const SimulatedWorld& world,
                                    std::size_t first_run) {
  const Se2 T_world_map = world.runs[first_run].truth.front().T_map_vehicle;
  std::vector<MatchedMode> matches;
  std::vector<PointPair> pairs;
  for (std::size_t g = 0; g < content.groups.size(); ++g) {
    const LandmarkGroup& group = content.groups[g];
    const auto truth =
        std::find_if(world.groups.begin(), world.groups.end(), [&](const SimulatedGroup& other) {
          return other.signature == group.signature;
        });
    SHIFTMAP_CHECK(truth != world.groups.end(), "no group '{}'", group.signature.text());
    for (std::size_t m = 0; m < group.modes.size(); ++m) {
      const Eigen::Vector2d p_world = T_world_map * group.modes[m].p_map_landmark;
      const auto nearest = std::min_element(
          truth->modes.begin(), truth->modes.end(), [&](const auto& a, const auto& b) {
            return (a - p_world).norm() < (b - p_world).norm();
          });
      matches.push_back({g, m, ModeNumber(nearest - truth->modes.begin() + 1)});
      pairs.push_back({group.modes[m].p_map_landmark, *nearest});
    }
  }
  const StatusOr<Se2> T_map_world = AlignRigid2d(pairs);
  SHIFTMAP_CHECK(T_map_world.ok(), "{}", Message(T_map_world.status()));
  for (std::size_t i = 0; i < matches.size(); ++i) {
    matches[i].error = pairs[i].p_a - *T_map_world * pairs[i].p_b;
  }
  return matches;
}

double ModeErrors::Scale() const {
  const Eigen::VectorXd offsets = OffsetsFromCentroid(positions);
  return offsets.dot(errors) / offsets.squaredNorm();
}

ModeErrors ErrorsOf(const MapContent& content, const SimulatedWorld& world) {
  const std::vector<MatchedMode> matches = MatchModes(content, world);
  ModeErrors result;
  result.errors.resize(static_cast<Eigen::Index>(2 * matches.size()));
  for (const MatchedMode& match : matches) {
    const auto row = static_cast<Eigen::Index>(2 * result.positions.size());
    result.positions.push_back(content.groups[match.group].modes[match.mode].p_map_landmark);
    result.errors.segment<2>(row) = match.error;
  }
  return result;
}

void MapConsistency::Add(const MapConsistency& other) {
  nees += other.nees;
  dof += other.dof;
  squared_error += other.squared_error;
  modes += other.modes;
}

MapConsistency ConsistencyOf(const Eigen::VectorXd& errors,
                             const Eigen::MatrixXd& covariance,
                             const Eigen::MatrixXd& unknown) {
  const Eigen::MatrixXd projector =
      Eigen::MatrixXd::Identity(errors.size(), errors.size()) - unknown * unknown.transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(
      Symmetrized(projector * covariance * projector));
  MapConsistency result;
  for (Eigen::Index i = unknown.cols(); i < errors.size(); ++i) {
    result.nees += std::pow(solver.eigenvectors().col(i).dot(errors), 2) / solver.eigenvalues()[i];
  }
  result.dof = static_cast<int>(errors.size() - unknown.cols());
  result.squared_error = errors.squaredNorm();
  result.modes = static_cast<int>(errors.size() / 2);
  return result;
}

MapConsistency MeasureConsistency(const MapContent& content, const SimulatedWorld& world) {
  const auto [positions, errors] = ErrorsOf(content, world);
  return ConsistencyOf(errors, content.covariance.Dense(), GaugeDirections(positions));
}

void ExpectRightVariances(const MapConsistency& maps) {
  const double most = ChiSquareQuantile(0.9995, maps.dof);
  EXPECT_GT(maps.nees, ChiSquareQuantile(0.0005, maps.dof)) << maps.dof << " degrees of freedom";
  EXPECT_LT(maps.nees, most) << maps.dof << " degrees of freedom";
  EXPECT_GT(maps.nees / 0.75, most) << "too few maps to see variances that are too small";
}

}  // namespace shiftmap::testing
