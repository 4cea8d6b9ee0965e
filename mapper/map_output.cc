// SPDX-License-Identifier: Apache-2.0
#include "mapper/map_output.h"

#include <algorithm>
#include <cmath>

#include "localizer/models/motion_model.h"
#include "localizer/models/observation_model.h"
#include "mapper/mode_refinement.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

constexpr double kInlierProbability = 0.999;
constexpr double kFieldOfViewQuantile = 0.99;
constexpr double kMinProbability = 1e-6;

// How much the systematic errors of a sensor that no run has calibrated yet differ from the
// fleet's.
constexpr double kRangeSpread = 0.03;     // [m]
constexpr double kBearingSpread = 0.015;  // [rad]

double Quantile(std::vector<double> values, double quantile) {
  const auto at = static_cast<std::ptrdiff_t>(quantile * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + at, values.end());
  return values[static_cast<std::size_t>(at)];
}

// Position of the mode that a sighting's visit is assigned to. Precondition: it is assigned to one.
const Eigen::Vector2d& AssignedPosition(const MapProblem& problem,
                                        const BuildRun& run,
                                        const Sighting& sighting) {
  const MappingVisit& visit = run.data->visits[static_cast<std::size_t>(sighting.visit)];
  const int mode = run.assignment[static_cast<std::size_t>(sighting.visit)];
  return problem.modes[static_cast<std::size_t>(visit.group)][static_cast<std::size_t>(mode)]
      .p_map_landmark;
}

bool IsInlier(const MapProblem& problem, const BuildRun& run, const Sighting& sighting) {
  static const double gate = ChiSquareQuantile(kInlierProbability, 2);
  if (run.assignment[static_cast<std::size_t>(sighting.visit)] == kNoMode) return false;
  const Innovation innovation =
      SightingInnovation(run, sighting, AssignedPosition(problem, run, sighting));
  return SquaredMahalanobis(innovation.nu, ObservationNoise(sighting.observation, problem.sensor)) <
         gate;
}

// Spread of innovations about zero, from the median of their squares, which a few outliers do not
// move.
double RobustSd(const std::vector<double>& squares) {
  constexpr double kSdOverMedianDeviation = 1.4826;
  return kSdOverMedianDeviation * std::sqrt(Quantile(squares, 0.5));
}

// The mapper takes each run's systematic errors off. What of them the fleet has in common goes into
// the sensor's calibration; what is each vehicle's own is noise to a localizer on a vehicle that no
// run has calibrated.
void SetFleetSensor(const MapProblem& problem, double sd_range_scale, SensorCalibration* sensor) {
  const auto runs = static_cast<double>(problem.runs.size());
  for (const BuildRun& run : problem.runs) {
    sensor->range_curvature_per_rad2 += run.sensor_bias[1] / runs;
    sensor->mean_squared_bearing_rad2 += run.data->mean_squared_bearing / runs;
  }
  const SensorBias common(0.0, sensor->range_curvature_per_rad2);
  std::vector<double> range;
  std::vector<double> bearing;
  std::vector<double> position;
  double squared_ranges = 0.0;
  for (const BuildRun& run : problem.runs) {
    for (const Sighting& sighting : run.data->sightings) {
      if (!IsInlier(problem, run, sighting)) continue;
      const Eigen::Vector2d squares =
          LinearizeBiased(sighting.observation,
                          run.poses[static_cast<std::size_t>(sighting.frame)],
                          AssignedPosition(problem, run, sighting),
                          common,
                          sensor->mean_squared_bearing_rad2)
              .nu.cwiseAbs2();
      if (sighting.observation.kind == Observation::Kind::kCartesian) {
        position.insert(position.end(), {squares.x(), squares.y()});
      } else {
        range.push_back(squares.x());
        bearing.push_back(squares.y());
        squared_ranges += sighting.observation.z.x() * sighting.observation.z.x();
      }
    }
  }
  const auto raise = [](const std::vector<double>& squares, double spread, double* sd) {
    if (!squares.empty()) *sd = std::hypot(std::max(*sd, RobustSd(squares)), spread);
  };
  const double rms_range =
      range.empty() ? 0.0 : std::sqrt(squared_ranges / static_cast<double>(range.size()));
  raise(range, std::hypot(kRangeSpread, sd_range_scale * rms_range), &sensor->sd_range_m);
  raise(bearing, kBearingSpread, &sensor->sd_bearing_rad);
  raise(position, kRangeSpread, &sensor->sd_position_m);
}

// The mode of every group at a key frame of a run: that of the visit going on, or of the one
// before, or of the first to come.
class ActiveModes {
 public:
  ActiveModes(const MapProblem& problem, const BuildRun& run)
      : run_(run), visits_(problem.signatures.size()) {
    for (std::size_t v = 0; v < run.data->visits.size(); ++v) {
      visits_[static_cast<std::size_t>(run.data->visits[v].group)].push_back(v);
    }
  }

  int At(std::size_t group, Stamp stamp) const {
    int mode = kNoMode;
    for (const std::size_t visit : visits_[group]) {
      if (mode != kNoMode && run_.data->visits[visit].begin > stamp) break;
      if (run_.assignment[visit] != kNoMode) mode = run_.assignment[visit];
    }
    return mode;
  }

 private:
  const BuildRun& run_;
  std::vector<std::vector<std::size_t>> visits_;
};

// Forward filter of the group's chain over its visits, from a uniform start to `end`.
Eigen::VectorXd FilterProbabilities(const MapProblem& problem,
                                    const std::vector<VisitRef>& visits,
                                    const ModeChain& chain,
                                    Eigen::VectorXd probabilities,
                                    Stamp now,
                                    Stamp end,
                                    const ModeOptions& options) {
  for (const VisitRef& ref : visits) {
    const MappingVisit& visit = problem.runs[static_cast<std::size_t>(ref.run)]
                                    .data->visits[static_cast<std::size_t>(ref.visit)];
    probabilities = chain.Propagate(probabilities, visit.begin - now);
    const Eigen::VectorXd log_likelihood = VisitLogLikelihood(problem, ref, options);
    probabilities.array() *= (log_likelihood.array() - log_likelihood.maxCoeff()).exp();
    probabilities = (probabilities / probabilities.sum()).cwiseMax(kMinProbability).eval();
    now = visit.end;
  }
  probabilities = chain.Propagate(probabilities, end - now);
  return probabilities / probabilities.sum();
}

const LandmarkGroup* FindGroup(const std::optional<MapContent>& map, const Signature& signature) {
  if (!map) return nullptr;
  for (const LandmarkGroup& group : map->groups) {
    if (group.signature == signature) return &group;
  }
  return nullptr;
}

// Modes of a group in the order they get: the prior's by number, then new ones by first visit.
std::vector<std::size_t> ModeOrder(const MapProblem& problem,
                                   const std::vector<VisitRef>& visits,
                                   const std::vector<BuildMode>& modes) {
  std::vector<std::size_t> order;
  std::vector<std::size_t> first_visit(modes.size(), visits.size());
  for (std::size_t v = visits.size(); v-- > 0;) {
    const BuildRun& run = problem.runs[static_cast<std::size_t>(visits[v].run)];
    const int mode = run.assignment[static_cast<std::size_t>(visits[v].visit)];
    if (mode != kNoMode) first_visit[static_cast<std::size_t>(mode)] = v;
  }
  for (std::size_t i = 0; i < modes.size(); ++i) order.push_back(i);
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    const bool a_known = modes[a].number != kAbsent;
    const bool b_known = modes[b].number != kAbsent;
    if (a_known != b_known) return a_known;
    return a_known ? modes[a].number < modes[b].number : first_visit[a] < first_visit[b];
  });
  return order;
}

Stamp LastSeen(const MapProblem& problem,
               const std::vector<VisitRef>& visits,
               int mode,
               Stamp known) {
  for (const VisitRef& ref : visits) {
    const BuildRun& run = problem.runs[static_cast<std::size_t>(ref.run)];
    if (run.assignment[static_cast<std::size_t>(ref.visit)] != mode) continue;
    known = std::max(known, run.data->visits[static_cast<std::size_t>(ref.visit)].end);
  }
  return known;
}

}  // namespace

SensorCalibration EstimateDetection(const MapProblem& problem, const ModeOptions& options) {
  SensorCalibration sensor = problem.sensor;
  std::vector<double> ranges;
  std::vector<double> bearings;
  int outliers = 0;
  for (const BuildRun& run : problem.runs) {
    for (const Sighting& sighting : run.data->sightings) {
      if (!IsInlier(problem, run, sighting)) {
        ++outliers;
        continue;
      }
      const Eigen::Vector2d q = sighting.observation.PositionInVehicle();
      ranges.push_back(q.norm());
      bearings.push_back(std::abs(std::atan2(q.y(), q.x())));
    }
  }
  if (static_cast<int>(ranges.size()) < options.min_sightings) return sensor;
  sensor.max_range_m = std::max(0.1, Quantile(ranges, kFieldOfViewQuantile));
  sensor.max_bearing_rad = std::max(0.01, Quantile(bearings, kFieldOfViewQuantile));

  double expected = 0.0;
  double detected = 0.0;
  double frames = 0.0;
  for (const BuildRun& run : problem.runs) {
    const ActiveModes active(problem, run);
    frames += static_cast<double>(run.data->frames.size());
    for (std::size_t f = 0; f < run.data->frames.size(); ++f) {
      const KeyFrame& frame = run.data->frames[f];
      const Se2 T_vehicle_map = run.poses[f].Inverse();
      std::vector<bool> seen(problem.signatures.size());
      for (int s = frame.first_sighting; s < frame.first_sighting + frame.sighting_count; ++s) {
        const Sighting& sighting = run.data->sightings[static_cast<std::size_t>(s)];
        if (!IsInlier(problem, run, sighting)) continue;
        seen[static_cast<std::size_t>(
            run.data->visits[static_cast<std::size_t>(sighting.visit)].group)] = true;
      }
      for (std::size_t group = 0; group < problem.modes.size(); ++group) {
        const int mode = active.At(group, frame.stamp);
        if (mode == kNoMode) continue;
        const Eigen::Vector2d q =
            T_vehicle_map * problem.modes[group][static_cast<std::size_t>(mode)].p_map_landmark;
        if (q.norm() > sensor.max_range_m ||
            std::abs(std::atan2(q.y(), q.x())) > sensor.max_bearing_rad)
          continue;
        expected += 1.0;
        detected += seen[group] ? 1.0 : 0.0;
      }
    }
  }
  // Beta(1, 1) prior, and never so certain that one scan decides.
  sensor.detection_probability = std::clamp((detected + 1.0) / (expected + 2.0), 0.05, 0.95);
  const double area = sensor.max_bearing_rad * sensor.max_range_m * sensor.max_range_m;
  sensor.clutter_density_per_m2 = std::clamp((outliers + 1.0) / (frames * area), 1e-7, 1e-2);
  return sensor;
}

// Random walk of a run's odometry over spans of this length: its errors are correlated over
// seconds, and from one key frame to the next they look smaller than what a gap between landmarks
// will cost.
constexpr double kNoiseSpanSeconds = 10.0;

Eigen::Vector2d LongTermNoise(const BuildRun& run) {
  std::vector<double> x_squares;
  std::vector<double> yaw_squares;
  std::size_t hint = 0;
  std::size_t first = 0;
  const std::vector<KeyFrame>& frames = run.data->frames;
  for (std::size_t i = 1; i < frames.size(); ++i) {
    const double seconds = ToSeconds(frames[i].stamp - frames[first].stamp);
    if (seconds < kNoiseSpanSeconds) continue;
    const MotionIncrement motion = IntegrateMotion(
        run.data->odometry, frames[first].stamp, frames[i].stamp, run.odometry, &hint);
    const Se2 T_first_i = run.poses[first].Inverse() * run.poses[i];
    const Eigen::Vector3d error = (motion.T_begin_end.Inverse() * T_first_i).Log();
    x_squares.push_back(error.x() * error.x() / seconds);
    yaw_squares.push_back(error.z() * error.z() / seconds);
    first = i;
  }
  if (x_squares.empty()) return Eigen::Vector2d::Zero();
  return {RobustSd(x_squares), RobustSd(yaw_squares)};
}

OdometryCalibration FleetOdometry(const std::vector<BuildRun>& runs,
                                  const OdometryCalibration& fallback) {
  const auto count = static_cast<double>(runs.size());
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  double lag = 0.0;
  Eigen::Vector2d variance = Eigen::Vector2d::Zero();
  for (const BuildRun& run : runs) {
    mean +=
        Eigen::Vector2d(std::log(run.odometry.scale_v), std::log(run.odometry.scale_omega)) / count;
    lag += run.odometry.lag_s / count;
    const Eigen::Vector2d short_term(run.odometry.noise_v, run.odometry.noise_omega);
    variance += short_term.cwiseMax(LongTermNoise(run)).cwiseAbs2() / count;
  }
  OdometryCalibration fleet = fallback;
  fleet.scale_v = std::exp(mean.x());
  fleet.scale_omega = std::exp(mean.y());
  fleet.lag_s = lag;
  fleet.noise_v = std::sqrt(variance.x());
  fleet.noise_omega = std::sqrt(variance.y());
  return fleet;
}

MapContent MakeMapContent(const MapProblem& problem,
                          const std::optional<MapContent>& prior,
                          const Eigen::MatrixXd& mode_covariance,
                          const MapperOptions& options) {
  MapContent content;
  content.stamp = prior ? prior->stamp : Stamp();
  for (const BuildRun& run : problem.runs) content.stamp = std::max(content.stamp, run.data->end());
  content.calibration = {FleetOdometry(problem.runs, options.calibration.odometry), problem.sensor};
  if (options.calibrate) {
    SetFleetSensor(problem, options.sd_range_scale, &content.calibration.sensor);
  }
  if (prior) content.anonymous_landmarks = prior->anonymous_landmarks;

  const FlatModes flat(problem);
  std::vector<int> flat_order;
  const std::vector<std::vector<VisitRef>> visits = VisitsByGroup(problem);
  for (std::size_t g = 0; g < problem.modes.size(); ++g) {
    const std::vector<BuildMode>& modes = problem.modes[g];
    if (modes.empty()) continue;
    const LandmarkGroup* known = FindGroup(prior, problem.signatures[g]);
    const std::vector<std::size_t> order = ModeOrder(problem, visits[g], modes);
    LandmarkGroup group;
    group.signature = problem.signatures[g];
    const auto states = static_cast<Eigen::Index>(modes.size()) + 1;
    const double rate =
        known != nullptr ? known->chain.leave_rate_per_s() : options.modes.leave_rate_per_s;
    group.chain = ModeChain::Uniform(static_cast<int>(modes.size()), rate);

    // In problem order; permuted with the modes below.
    Eigen::VectorXd start = Eigen::VectorXd::Constant(states, 1.0 / static_cast<double>(states));
    Stamp now = visits[g].empty() ? content.stamp : problem.runs.front().data->begin();
    if (known != nullptr) {
      start.setConstant(kMinProbability);
      start[0] = std::max(known->probabilities[0], kMinProbability);
      for (std::size_t k = 0; k < modes.size(); ++k) {
        const int state = known->StateOf(modes[k].number);
        if (state > 0)
          start[static_cast<Eigen::Index>(k) + 1] =
              std::max(known->probabilities[state], kMinProbability);
      }
      start /= start.sum();
      now = prior->stamp;
    }
    const Eigen::VectorXd probabilities = FilterProbabilities(
        problem, visits[g], group.chain, start, now, content.stamp, options.modes);
    group.probabilities.resize(states);
    group.probabilities[0] = probabilities[0];

    ModeNumber next(1);
    for (const std::size_t k : order) {
      Mode mode;
      const bool in_prior = modes[k].number != kAbsent;
      mode.number = in_prior ? modes[k].number : next;
      next = ModeNumber(mode.number.value() + 1);
      mode.p_map_landmark = modes[k].p_map_landmark;
      Stamp last_seen;
      if (in_prior)
        last_seen =
            known->modes[static_cast<std::size_t>(known->StateOf(mode.number)) - 1].last_seen;
      mode.last_seen = LastSeen(problem, visits[g], static_cast<int>(k), last_seen);
      group.modes.push_back(mode);
      group.probabilities[static_cast<Eigen::Index>(group.modes.size())] =
          probabilities[static_cast<Eigen::Index>(k) + 1];
      flat_order.push_back(flat.Index(static_cast<int>(g), static_cast<int>(k)));
    }
    content.groups.push_back(std::move(group));
  }

  const auto count = static_cast<Eigen::Index>(flat_order.size());
  Eigen::MatrixXd cov(2 * count, 2 * count);
  for (Eigen::Index i = 0; i < count; ++i) {
    for (Eigen::Index j = 0; j < count; ++j) {
      cov.block<2, 2>(2 * i, 2 * j) = mode_covariance.block<2, 2>(
          2 * flat_order[static_cast<std::size_t>(i)], 2 * flat_order[static_cast<std::size_t>(j)]);
    }
  }
  content.covariance = JointCovariance::FromDense(cov);
  Eigen::Index at = 0;
  for (LandmarkGroup& group : content.groups) {
    for (Mode& mode : group.modes) {
      mode.cov_p_map_landmark = cov.block<2, 2>(at, at);
      at += 2;
    }
  }
  return content;
}

MappedRun MakeMappedRun(const MapProblem& problem, std::size_t index) {
  const BuildRun& run = problem.runs[index];
  MappedRun mapped;
  mapped.name = run.data->name;
  mapped.sha256 = run.data->sha256;
  mapped.vehicle = run.data->info.vehicle;
  mapped.begin = run.data->begin();
  mapped.end = run.data->end();
  mapped.poses = static_cast<int>(run.poses.size());
  mapped.observations = static_cast<int>(run.data->sightings.size());
  mapped.odometry = run.odometry;
  mapped.sensor_bias = run.sensor_bias;
  for (std::size_t f = 0; f < run.poses.size(); ++f) {
    mapped.trajectory.push_back({run.data->frames[f].stamp, run.poses[f]});
  }
  for (const Sighting& sighting : run.data->sightings) {
    if (!IsInlier(problem, run, sighting)) {
      ++mapped.outliers;
      continue;
    }
    const Innovation innovation =
        SightingInnovation(run, sighting, AssignedPosition(problem, run, sighting));
    mapped.chi2 +=
        SquaredMahalanobis(innovation.nu, ObservationNoise(sighting.observation, problem.sensor));
  }
  std::size_t hint = 0;
  const Stamp first = run.data->frames.front().stamp;
  const Se2 T_start_first =
      first < mapped.begin
          ? Se2()
          : IntegrateMotion(run.data->odometry, mapped.begin, first, run.odometry, &hint)
                .T_begin_end;
  mapped.T_map_start = run.poses.front() * T_start_first.Inverse();
  return mapped;
}

}  // namespace shiftmap
