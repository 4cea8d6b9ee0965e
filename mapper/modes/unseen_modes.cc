// SPDX-License-Identifier: Apache-2.0
#include "mapper/modes/unseen_modes.h"

#include <algorithm>
#include <map>
#include <set>
#include <tuple>
#include <utility>

#include "localizer/models/detection_model.h"
#include "mapper/calibration/detection.h"
#include "mapstore/map/shift_report_check.h"

namespace shiftmap {
namespace {

// A visit of a landmark in an older run.
using VisitKey = std::tuple<std::string, Signature, Stamp, Stamp>;

std::set<VisitKey> VisitsOf(const std::vector<EvidenceRow>& ledger) {
  std::set<VisitKey> visits;
  for (const EvidenceRow& row : ledger) {
    const VisitEvidence& visit = row.evidence;
    visits.emplace(row.source, visit.signature, visit.begin, visit.end);
  }
  return visits;
}

// The poses of a run from which a place was well in view.
struct Passes {
  std::vector<DirectionCounts> counts;
  Stamp begin;
  Stamp end;
};

Passes PassesOf(const RunRecord& run,
                const Eigen::Vector2d& p_map_landmark,
                Duration pass_gap,
                const SensorCalibration& sensor) {
  Passes passes;
  for (const StampedPose& pose : run.trajectory) {
    const Eigen::Vector2d view = pose.T_map_vehicle.translation() - p_map_landmark;
    if (view.norm() > sensor.max_range_m) continue;
    if (!WellInView(pose.T_map_vehicle.Inverse() * p_map_landmark, SectorOf(sensor))) continue;
    if (passes.counts.empty()) passes.begin = pose.stamp;
    if (passes.counts.empty() || pose.stamp - passes.end > pass_gap) passes.counts.push_back({});
    passes.end = pose.stamp;
    ++passes.counts.back()[DirectionOf(view)];
  }
  return passes;
}

}  // namespace

std::vector<RunRecord> FindUnseenModes(const std::vector<RunRecord>& runs,
                                       const std::vector<NewMode>& modes,
                                       const std::vector<EvidenceRow>& ledger,
                                       double pass_gap_s,
                                       const SensorCalibration& sensor,
                                       const MissedDetectionOptions& options) {
  std::vector<RunRecord> result;
  const std::set<VisitKey> visits = VisitsOf(ledger);
  for (const RunRecord& run : runs) {
    std::map<Signature, VisitEvidence> by_landmark;
    for (const NewMode& mode : modes) {
      const Passes passes = PassesOf(run, mode.p_map_landmark, FromSeconds(pass_gap_s), sensor);
      if (passes.counts.empty()) continue;
      const double missed = LogMissedPasses(passes.counts, mode.scans, sensor, options);
      const auto [visit, is_new] = by_landmark.try_emplace(
          mode.signature,
          VisitEvidence{mode.signature, passes.begin, passes.end, {{kAbsent, 0.0}}, 0});
      visit->second.begin = std::min(visit->second.begin, passes.begin);
      visit->second.end = std::max(visit->second.end, passes.end);
      // A visit says no more than the ledger takes, whatever the number of passes.
      visit->second.modes.push_back({mode.number, std::max(missed, -kMaxVisitLogRatio)});
    }
    if (by_landmark.empty()) continue;
    RunRecord& older = result.emplace_back(run);
    older.trajectory.clear();
    for (auto& [signature, visit] : by_landmark) {
      // Two rows of a run about a landmark and the same time would be one.
      const bool taken = visits.contains({run.sha256, signature, visit.begin, visit.end});
      if (taken && visit.begin > run.begin) visit.begin -= Duration(1);
      older.evidence.push_back(std::move(visit));
    }
  }
  return result;
}

}  // namespace shiftmap
