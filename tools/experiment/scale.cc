// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/scale.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <map>
#include <set>
#include <utility>

#include "mapper/covariance/gauge.h"
#include "mapper/mapper.h"
#include "mapstore/core/median.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/run/trajectory.h"
#include "tools/experiment/processor_time.h"
#include "tools/sim/open_world.h"

namespace shiftmap {
namespace {

constexpr double kScanRate = 2.0;           // [1/s]
constexpr double kScansPerKeyFrame = 1.55;  // The others see nothing.
constexpr double kSquareMetres = 80.0;      // Of floor for each landmark. [m²]
constexpr double kMib = 1024.0 * 1024.0;

double PeakMib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) * 1024.0 / kMib;
}

double ResidentMib() {
  long pages = 0;
  if (std::FILE* file = std::fopen("/proc/self/statm", "r")) {
    if (std::fscanf(file, "%*d %ld", &pages) != 1) pages = 0;
    std::fclose(file);
  }
  return static_cast<double>(pages) * static_cast<double>(sysconf(_SC_PAGESIZE)) / kMib;
}

OpenWorldOptions SiteOptions(const ScaleOptions& options, int key_frames) {
  OpenWorldOptions site;
  site.seed = options.seed;
  const auto scans = static_cast<int>(kScansPerKeyFrame * key_frames);
  site.runs = std::max(1, scans / options.scans_per_run);
  site.duration_s = static_cast<double>(scans) / site.runs / kScanRate;
  site.scan_rate_hz = kScanRate;
  site.groups = std::clamp(scans / options.scans_per_group, 20, options.max_groups);
  site.size_m = std::sqrt(kSquareMetres * site.groups);
  site.mode_change_probability = 0.1;
  site.clutter_per_scan = options.misread_per_scan;
  site.odometry.noise_v *= options.odometry_noise;
  site.odometry.noise_omega *= options.odometry_noise;
  return site;
}

using Place = std::pair<std::size_t, ModeNumber>;  // Of a landmark, by its index.

// Adds the places of landmarks that a run saw well enough for a mode: in one visit as often as one
// needs.
void AddSeen(const SimulatedRun& run,
             const std::map<Signature, std::size_t>& index,
             const MapperOptions& mapper,
             std::set<Place>* seen) {
  struct Visit {
    Stamp last;
    int sightings = 0;
  };
  std::map<std::size_t, Visit> visits;
  for (const Scan& scan : run.run.scans) {
    for (const Observation& observation : scan.observations) {
      const std::size_t group = index.at(observation.signature);
      Visit& visit = visits[group];
      const bool goes_on =
          visit.sightings > 0 && ToSeconds(scan.stamp - visit.last) <= mapper.front_end.visit_gap_s;
      visit = {scan.stamp, goes_on ? visit.sightings + 1 : 1};
      if (visit.sightings == mapper.modes.min_sightings) {
        seen->emplace(group, run.active_mode[group]);
      }
    }
  }
}

// A map's modes beside the nearest true place of their landmark.
std::vector<PointPair> PairWithTruth(const MapContent& content,
                                     const std::map<Signature, std::size_t>& index,
                                     const std::vector<SimulatedGroup>& truth,
                                     const Se2& T_truth_map) {
  std::vector<PointPair> pairs;
  for (const LandmarkGroup& group : content.groups) {
    const std::vector<Eigen::Vector2d>& places = truth[index.at(group.signature)].modes;
    for (const Mode& mode : group.modes) {
      const Eigen::Vector2d p = T_truth_map * mode.p_map_landmark;
      const auto nearest =
          std::min_element(places.begin(), places.end(), [&](const auto& a, const auto& b) {
            return (a - p).squaredNorm() < (b - p).squaredNorm();
          });
      pairs.push_back({mode.p_map_landmark, *nearest});
    }
  }
  return pairs;
}

// Errors in standard deviations, squared: 2 on average if the map's covariances are right.
double MeanSquaredDeviation(const MapContent& content, const std::vector<Eigen::Vector2d>& errors) {
  double sum = 0.0;
  std::size_t i = 0;
  for (const LandmarkGroup& group : content.groups) {
    for (const Mode& mode : group.modes) {
      sum += SquaredMahalanobis(errors[i++], mode.cov_p_map_landmark);
    }
  }
  return sum / static_cast<double>(errors.size());
}

// Takes out of errors at some positions what makes the whole map larger, and returns it.
double RemoveScaleError(const std::vector<Eigen::Vector2d>& positions,
                        std::vector<Eigen::Vector2d>* errors) {
  const Eigen::VectorXd offsets = OffsetsFromCentroid(positions);
  double along = 0.0;
  for (std::size_t i = 0; i < errors->size(); ++i) {
    along += offsets.segment<2>(static_cast<Eigen::Index>(2 * i)).dot((*errors)[i]);
  }
  const double squares = offsets.squaredNorm();
  const double scale = squares > 0.0 ? along / squares : 0.0;
  for (std::size_t i = 0; i < errors->size(); ++i) {
    (*errors)[i] -= scale * offsets.segment<2>(static_cast<Eigen::Index>(2 * i));
  }
  return scale;
}

// Errors of a map's modes, with the map where it is nearest to the truth.
// @param T_truth_start  Near which that is: at the far end of a site off by metres, so that some
//                       modes are first paired with the wrong place.
Status Score(const MapContent& content,
             const std::map<Signature, std::size_t>& index,
             const std::vector<SimulatedGroup>& truth,
             const Se2& T_truth_start,
             ScaleRow* row) {
  constexpr int kPairings = 3;
  Se2 T_map_truth = T_truth_start.Inverse();
  std::vector<PointPair> pairs;
  for (int i = 0; i < kPairings; ++i) {
    pairs = PairWithTruth(content, index, truth, T_map_truth.Inverse());
    SHIFTMAP_ASSIGN_OR_RETURN(T_map_truth, AlignRigid2d(pairs));
  }
  double squares = 0.0;
  std::vector<Eigen::Vector2d> positions;
  std::vector<Eigen::Vector2d> errors;
  std::vector<double> distances;
  for (const PointPair& pair : pairs) {
    const Eigen::Vector2d& position = positions.emplace_back(T_map_truth * pair.p_b);
    const Eigen::Vector2d& error = errors.emplace_back(pair.p_a - position);
    squares += error.squaredNorm();
    distances.push_back(error.norm());
    row->far_modes += error.norm() >= 1.0;
  }
  row->rms_m = std::sqrt(squares / static_cast<double>(pairs.size()));
  row->median_m = Median(std::move(distances));
  row->nees = MeanSquaredDeviation(content, errors);
  row->scale_error = RemoveScaleError(positions, &errors);
  row->nees_shape = MeanSquaredDeviation(content, errors);
  return OkStatus();
}

StatusOr<ScaleRow> BuildSite(const ScaleOptions& options, int key_frames) {
  SHIFTMAP_ASSIGN_OR_RETURN(SimulatedWorld world, SimulateOpen(SiteOptions(options, key_frames)));
  ScaleRow row;
  MapperOptions mapper;
  mapper.threads = options.threads;
  mapper.sd_range_scale = 0.0;  // Simulated sensors have the same scale, which is right.
  mapper.sd_run_range_scale = 1e-6;
  std::map<Signature, std::size_t> index;
  for (std::size_t g = 0; g < world.groups.size(); ++g) index[world.groups[g].signature] = g;
  const std::vector<SimulatedGroup> truth = world.groups;
  const Se2 T_truth_start = world.runs.front().truth.front().T_map_vehicle;
  std::set<Place> places;
  std::set<Place> seen;
  std::vector<MapperInput> inputs;
  for (SimulatedRun& run : world.runs) {
    AddSeen(run, index, mapper, &seen);
    for (std::size_t group = 0; group < run.active_mode.size(); ++group) {
      if (run.active_mode[group] != kAbsent) places.emplace(group, run.active_mode[group]);
    }
    const std::string name = fmt::format("run{}", inputs.size() + 1);
    inputs.push_back({name, name, std::move(run.run)});
  }
  world = SimulatedWorld();
  row.true_modes = static_cast<int>(places.size());
  row.seen_modes = static_cast<int>(seen.size());
  row.logs_mib = ResidentMib();
  const auto wall_begin = std::chrono::steady_clock::now();
  const double begin = ProcessorSeconds();
  SHIFTMAP_ASSIGN_OR_RETURN(const MapperResult result,
                            BuildMap(std::move(inputs), std::nullopt, mapper));
  row.build_s = ProcessorSeconds() - begin;
  row.wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - wall_begin).count();
  for (const MappedRun& run : result.runs) row.key_frames += run.poses;
  row.runs = static_cast<int>(result.runs.size());
  row.rejected = static_cast<int>(result.rejected.size());
  row.groups = static_cast<int>(result.content.groups.size());
  for (const LandmarkGroup& group : result.content.groups) {
    row.modes += static_cast<int>(group.modes.size());
  }
  SHIFTMAP_RETURN_IF_ERROR(Score(result.content, index, truth, T_truth_start, &row));
  row.us_per_frame = 1e6 * row.build_s / std::max(1, row.key_frames);
  row.peak_mib = PeakMib();
  return row;
}

}  // namespace

Status ScaleOptions::Validate() const {
  if (key_frames.empty() || !std::is_sorted(key_frames.begin(), key_frames.end()) ||
      key_frames.front() < 100) {
    return InvalidArgument("key_frames: expected ascending numbers of 100 or more");
  }
  if (threads < 1) return InvalidArgument("threads: {}, expected 1 or more", threads);
  if (!(misread_per_scan >= 0.0) || !(odometry_noise > 0.0)) {
    return InvalidArgument("misread_per_scan, odometry_noise: expected at least and more than 0");
  }
  if (scans_per_run < 100 || scans_per_group < 1 || max_groups < 20) {
    return InvalidArgument(
        "scans_per_run, scans_per_group, max_groups: expected at least 100, 1 and 20");
  }
  return OkStatus();
}

StatusOr<std::vector<ScaleRow>> RunScale(const ScaleOptions& options,
                                         const ScaleProgress& progress) {
  SHIFTMAP_RETURN_IF_ERROR(options.Validate());
  std::vector<ScaleRow> rows;
  for (const int key_frames : options.key_frames) {
    if (progress) {
      progress(static_cast<double>(rows.size()) / static_cast<double>(options.key_frames.size()));
    }
    SHIFTMAP_ASSIGN_OR_RETURN(ScaleRow row, BuildSite(options, key_frames));
    rows.push_back(row);
  }
  return rows;
}

}  // namespace shiftmap
