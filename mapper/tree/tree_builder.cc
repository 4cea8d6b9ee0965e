// SPDX-License-Identifier: Apache-2.0
#include "mapper/tree/tree_builder.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "localizer/models/motion_model.h"
#include "mapper/calibration/detection.h"
#include "mapper/covariance/gauge.h"
#include "mapper/frontend/mapping_run.h"
#include "mapper/frontend/pair_calibration.h"
#include "mapper/map_output.h"
#include "mapper/tree/run_start.h"
#include "mapper/tree/tree_slam.h"
#include "mapstore/map/map_scale.h"

namespace shiftmap {
namespace {

constexpr double kMib = 1024.0 * 1024.0;

// A run with its own calibration.
struct TreeRun {
  const MapperInput* input = nullptr;
  Calibration calibration;
  int observations = 0;  // Of identified landmarks.
  int duplicates = 0;
  int near = 0;
};

// Pairs of sightings a moment apart tell the noise that changes within a moment. A filter needs
// that of errors that last longer, too: the noise that is configured is the least.
void AtLeast(const SensorCalibration& configured, SensorCalibration* sensor) {
  sensor->sd_range_m = std::max(sensor->sd_range_m, configured.sd_range_m);
  sensor->sd_bearing_rad = std::max(sensor->sd_bearing_rad, configured.sd_bearing_rad);
  sensor->sd_position_m = std::max(sensor->sd_position_m, configured.sd_position_m);
}

TreeRun PrepareRun(const MapperInput& input, const MapperOptions& options) {
  const std::vector<Signature> signatures = CollectSignatures({&input.run}, {});
  const MappingRun run = MakeMappingRun(input.run, signatures, options.front_end);
  TreeRun prepared;
  prepared.input = &input;
  prepared.calibration =
      options.calibrate ? CalibrateFromPairs(run, options.calibration) : options.calibration;
  AtLeast(options.calibration.sensor, &prepared.calibration.sensor);
  prepared.observations = static_cast<int>(run.sightings.size());
  prepared.duplicates = run.duplicate_observations;
  prepared.near = run.near_observations;
  return prepared;
}

// Mean of the runs, for the map: scales and lag of odometry, mean squares of noise.
Calibration FleetCalibration(const std::vector<TreeRun>& runs, const Calibration& fallback) {
  if (runs.empty()) return fallback;
  Calibration fleet = fallback;
  const auto mean = [&](auto value) {
    double sum = 0.0;
    for (const TreeRun& run : runs) sum += value(run.calibration);
    return sum / static_cast<double>(runs.size());
  };
  fleet.odometry.scale_v =
      std::exp(mean([](const auto& c) { return std::log(c.odometry.scale_v); }));
  fleet.odometry.scale_omega =
      std::exp(mean([](const auto& c) { return std::log(c.odometry.scale_omega); }));
  fleet.odometry.lag_s = mean([](const auto& c) { return c.odometry.lag_s; });
  for (double SensorCalibration::*sd : {&SensorCalibration::sd_range_m,
                                        &SensorCalibration::sd_bearing_rad,
                                        &SensorCalibration::sd_position_m}) {
    fleet.sensor.*sd = std::sqrt(mean([&](const auto& c) { return std::pow(c.sensor.*sd, 2); }));
  }
  return fleet;
}

SensorCalibration SeenFrom(const std::vector<TreeRun>& runs, SensorCalibration sensor) {
  std::vector<Eigen::Vector2d> positions;
  for (const TreeRun& run : runs) {
    for (const Scan& scan : run.input->run.scans) {
      for (const Observation& observation : scan.observations) {
        positions.push_back(observation.PositionInVehicle());
      }
    }
  }
  if (!positions.empty()) SetFieldOfView(positions, &sensor);
  return sensor;
}

// Refers the covariance to the landmarks as a whole, and adds the scale that no run tells.
void ReferCovariance(double sd_scale, MapContent* content) {
  std::vector<Eigen::Vector2d> positions;
  for (const LandmarkGroup& group : content->groups) {
    for (const Mode& mode : group.modes) positions.push_back(mode.p_map_landmark);
  }
  const Eigen::MatrixXd cov = AddScaleUncertainty(
      positions, sd_scale, ReferToPositions(positions, content->covariance.Dense()));
  content->covariance = JointCovariance::FromDense(cov);
  SetMarginals(content);
}

// Filters runs one after the other.
class Pass {
 public:
  Pass(const std::optional<MapContent>& prior,
       const Calibration& calibration,
       const MapperOptions& options,
       const TreeSlamOptions& tree,
       const MapperMonitor& monitor)
      : calibration_(calibration),
        options_(options),
        monitor_(monitor),
        field_of_view_(tree.field_of_view),
        tree_(tree),
        slam_(tree, calibration, prior),
        known_(prior && !prior->groups.empty()) {}

  Status Filter(const std::vector<TreeRun>& runs, double from, double to) {
    for (std::size_t i = 0; i < runs.size(); ++i) {
      const double share = (to - from) / static_cast<double>(runs.size());
      SHIFTMAP_RETURN_IF_ERROR(FilterRun(runs[i], from + share * static_cast<double>(i), share));
    }
    return OkStatus();
  }

  TreeSlam& slam() { return slam_; }
  std::vector<MappedRun>& runs() { return runs_; }
  std::vector<RejectedRun>& rejected() { return rejected_; }

 private:
  Status FilterRun(const TreeRun& run, double done, double share) {
    const Run& log = run.input->run;
    std::optional<RunStart> start = RunStart();
    if (known_) {
      SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, Snapshot());
      start = FindRunStart(log, map, run.calibration.odometry);
    }
    if (run.observations == 0 || !start) {
      rejected_.push_back({run.input->name,
                           run.observations == 0 ? "no identified landmark is seen"
                                                 : "it fits no place of the map for certain"});
      return OkStatus();
    }
    MappedRun mapped = Describe(run);
    if (start->scan > 0) {
      Begin(*start, run, TreeSlam::Direction::kBackward);
      for (std::size_t i = start->scan; i-- > 0;) {
        if (i % 50 == 0) SHIFTMAP_RETURN_IF_ERROR(StepCallback(run, done));
        Step(run, i + 1, i, &mapped);
      }
      End(&mapped);
      std::reverse(mapped.trajectory.begin(), mapped.trajectory.end());
    }
    Begin(*start, run, TreeSlam::Direction::kForward);
    hint_ = 0;
    for (std::size_t i = start->scan; i < log.scans.size(); ++i) {
      if (i % 50 == 0) SHIFTMAP_RETURN_IF_ERROR(StepCallback(run, done + share * Share(i, log)));
      Step(run, std::max(i, start->scan + 1) - 1, i, &mapped);
    }
    End(&mapped);
    mapped.poses = static_cast<int>(mapped.trajectory.size());
    mapped.odometry = slam_.Odometry();
    mapped.T_map_start = PoseAtBegin(log.odometry,
                                     run.calibration.odometry,
                                     log.scans.front().stamp,
                                     mapped.trajectory.front().T_map_vehicle);
    const auto& groups = slam_.groups();
    known_ = std::any_of(groups.begin(), groups.end(), [](const LandmarkGroup& group) {
      return !group.modes.empty();
    });
    if (!known_) {  // Nothing says where other runs are from what it mapped.
      rejected_.push_back({run.input->name,
                           fmt::format("it has {} sightings of no landmark", tree_.min_sightings)});
      slam_ = TreeSlam(tree_, calibration_, std::nullopt);
      return OkStatus();
    }
    runs_.push_back(std::move(mapped));
    return OkStatus();
  }

  void Begin(const RunStart& start, const TreeRun& run, TreeSlam::Direction direction) {
    const Stamp stamp = run.input->run.scans[start.scan].stamp;
    if (known_) {
      slam_.BeginRunOnMap(start.pose, run.calibration, stamp, direction);
    } else {
      slam_.BeginRun(start.pose, run.calibration, stamp, direction);
    }
  }

  // From one scan of a run to another, later or earlier.
  void Step(const TreeRun& run, std::size_t from, std::size_t to, MappedRun* mapped) {
    const Run& log = run.input->run;
    const Stamp begin = log.scans[std::min(from, to)].stamp;
    const Stamp end = log.scans[std::max(from, to)].stamp;
    if (from != to) {
      std::size_t hint = to > from ? hint_ : 0;
      const MotionIncrement motion =
          IntegrateMotion(log.odometry, begin, end, run.calibration.odometry, &hint);
      if (to > from) hint_ = hint;
      slam_.Predict(to > from ? motion : Inverse(motion));
    }
    const LidarView lidar = LidarViewAt(run, log.scans[to].stamp);
    const TreeEvents& events = slam_.Correct(log.scans[to], &lidar);
    mapped->evidence.insert(mapped->evidence.end(), events.evidence.begin(), events.evidence.end());
    mapped->outliers += events.ungated;
    mapped->chi2 += events.nis_sum;
    mapped->trajectory.push_back({log.scans[to].stamp, slam_.best().filter.state().pose()});
  }

  // The last scan of the run's lidar by then, if the field of view goes by it.
  LidarView LidarViewAt(const TreeRun& run, Stamp stamp) const {
    const Run& log = run.input->run;
    LidarView view;
    if (field_of_view_.model != FieldOfViewModel::kScanPolygon) return view;
    const auto later =
        std::upper_bound(log.lidar_scans.begin(),
                         log.lidar_scans.end(),
                         stamp,
                         [](Stamp wanted, const LidarScan& scan) { return wanted < scan.stamp; });
    if (later == log.lidar_scans.begin()) return view;
    const LidarScan& scan = *std::prev(later);
    const double age_s = ToSeconds(stamp - scan.stamp);
    if (age_s > field_of_view_.max_lidar_age_s) return view;
    view.Take(scan);
    std::size_t hint = hint_;
    const MotionIncrement since =
        IntegrateMotion(log.odometry, scan.stamp, stamp, run.calibration.odometry, &hint);
    view.Move(since.T_begin_end, age_s, stamp, field_of_view_.max_lidar_age_s);
    return view;
  }

  void End(MappedRun* mapped) {
    for (VisitEvidence& visit : slam_.EndRun()) mapped->evidence.push_back(std::move(visit));
  }

  static double Share(std::size_t i, const Run& log) {
    return static_cast<double>(i) / static_cast<double>(log.scans.size());
  }

  // Every leaf has the joint covariance of all landmarks.
  Status CheckMemory() const {
    const double states = 2.0 * static_cast<double>(slam_.best().filter.state().size());
    const auto leaves = slam_.leaves().owned();
    const double bytes = 8.0 * states * states * static_cast<double>(leaves);
    if (options_.max_memory_bytes <= 0 || bytes <= static_cast<double>(options_.max_memory_bytes)) {
      return OkStatus();
    }
    return InvalidArgument(
        "a tree of {} leaves over {:.0f} landmarks takes {:.0f} MiB, more than {} MiB: fewer "
        "leaves, or the graph engine, take less",
        leaves,
        0.5 * states,
        bytes / kMib,
        options_.max_memory_bytes / static_cast<std::int64_t>(kMib));
  }

  Status StepCallback(const TreeRun& run, double done) const {
    SHIFTMAP_RETURN_IF_ERROR(CheckMemory());
    if (!monitor_) return OkStatus();
    std::size_t modes = 0;
    for (const LandmarkGroup& group : slam_.groups()) modes += group.modes.size();
    const bool on_step = monitor_({fmt::format("run {}", run.input->name), done, 0.0, modes});
    return on_step ? OkStatus() : MakeStatus(StatusCode::kCancelled, "build: stopped");
  }

  StatusOr<MapSnapshot> Snapshot() {
    MapContent content = slam_.Content();
    content.calibration = calibration_;
    ReferCovariance(0.0, &content);  // The first pose is of no interest to where a run starts.
    SHIFTMAP_RETURN_IF_ERROR(ValidateMapContent(content));
    return MapSnapshot("", VersionNumber(1), "", std::move(content));
  }

  static MappedRun Describe(const TreeRun& run) {
    MappedRun mapped;
    mapped.name = run.input->name;
    mapped.sha256 = run.input->sha256;
    mapped.uuid = run.input->run.info.uuid;
    mapped.vehicle = run.input->run.info.vehicle;
    mapped.begin = BeginOf(run.input->run);
    mapped.end = EndOf(run.input->run);
    mapped.observations = run.observations;
    mapped.duplicate_observations = run.duplicates;
    mapped.near_observations = run.near;
    return mapped;
  }

  Calibration calibration_;
  const MapperOptions& options_;
  const MapperMonitor& monitor_;
  FieldOfViewOptions field_of_view_;
  TreeSlamOptions tree_;
  TreeSlam slam_;
  std::size_t hint_ = 0;  // Of IntegrateMotion(), for the present run.
  bool known_;            // There is a map to find a run on.
  std::vector<MappedRun> runs_;
  std::vector<RejectedRun> rejected_;
};

// Gives the groups the chains that the ledger and the runs' visits speak for.
StatusOr<std::vector<GroupChain>> LearnChainsOf(const std::vector<MappedRun>& runs,
                                                const MapperOptions& options,
                                                std::vector<LandmarkGroup>* groups) {
  std::vector<EvidenceRow> rows;
  for (const MappedRun& run : runs) {
    for (const VisitEvidence& visit : run.evidence) {
      rows.push_back({run.sha256, visit, run.vehicle});
    }
  }
  const auto always = [](std::size_t) { return true; };
  return LearnChains(std::move(rows), options, always, groups);
}

}  // namespace

StatusOr<MapperResult> BuildMapByTree(std::vector<MapperInput> inputs,
                                      const std::optional<MapContent>& prior,
                                      const MapperOptions& options,
                                      const TreeSlamOptions& tree,
                                      const MapperMonitor& monitor) {
  SHIFTMAP_RETURN_IF_ERROR(CheckInputs(inputs, prior, options));
  SHIFTMAP_RETURN_IF_ERROR(tree.Validate());
  if (inputs.empty()) return InvalidArgument("no runs to build from");
  SortByBegin(&inputs);
  MapperOptions with_prior = options;
  std::optional<MapContent> known = prior;
  double sd_scale = options.sd_range_scale;
  if (known) {
    with_prior.calibration = known->calibration;
    sd_scale = std::max(sd_scale, RemoveScale(options.sd_range_scale, &*known).sd);
  }
  std::vector<TreeRun> runs;
  for (const MapperInput& input : inputs) runs.push_back(PrepareRun(input, with_prior));
  Calibration calibration = FleetCalibration(runs, with_prior.calibration);
  const bool learn_sensor = options.calibrate && !known;
  if (learn_sensor) {
    calibration.sensor = SeenFrom(runs, calibration.sensor);
    Pass first(known, calibration, options, tree, monitor);
    SHIFTMAP_RETURN_IF_ERROR(first.Filter(runs, 0.0, 0.5));
    SetDetection(first.slam().detections(), &calibration.sensor);
  }
  Pass pass(known, calibration, options, tree, monitor);
  SHIFTMAP_RETURN_IF_ERROR(pass.Filter(runs, learn_sensor ? 0.5 : 0.0, 1.0));
  if (pass.runs().empty()) {
    return InvalidArgument("no run can be used: {}", ReasonsOf(pass.rejected()));
  }
  MapperResult result;
  result.runs = std::move(pass.runs());
  result.rejected = std::move(pass.rejected());
  result.content = pass.slam().Content();
  if (result.content.groups.empty()) {
    return InvalidArgument("no run can be used: none has {} sightings of one landmark",
                           tree.min_sightings);
  }
  result.content.calibration = calibration;
  if (known) result.content.vehicles = known->vehicles;
  if (options.now) result.content.stamp = std::min(result.content.stamp, *options.now);
  ReferCovariance(sd_scale, &result.content);
  if (options.chains.learn && options.modes.leave_rate_per_s > 0.0) {
    SHIFTMAP_ASSIGN_OR_RETURN(result.chains,
                              LearnChainsOf(result.runs, options, &result.content.groups));
  }
  SHIFTMAP_RETURN_IF_ERROR(ValidateMapContent(result.content));
  result.modes_created = result.content.covariance.size() - (known ? known->covariance.size() : 0);
  result.modes_merged = pass.slam().modes_merged();
  result.outer_iterations = 1;
  return result;
}

}  // namespace shiftmap
