// SPDX-License-Identifier: Apache-2.0
#include "mapper/modes/missed_visits.h"

#include <algorithm>
#include <cstddef>
#include <map>
#include <optional>
#include <tuple>
#include <utility>

#include "localizer/models/detection_model.h"
#include "localizer/models/mode_grid.h"
#include "mapper/calibration/detection.h"
#include "mapper/state/sightings.h"

namespace shiftmap {
namespace {

// Scans without a detection of one mode in one gap between visits of its group.
struct MissedMode {
  std::vector<DirectionCounts> passes;
  Stamp begin;
  Stamp end;
};

// A gap is named by the number of visits of the group before it.
struct GapRef {
  GroupIndex group;
  RunIndex run;
  std::size_t gap = 0;

  auto operator<=>(const GapRef&) const = default;
};

// The visits of each group in one run, by begin, asked in the order of time.
class RunTimeline {
 public:
  RunTimeline(const BuildState& build, const BuildRun& run)
      : run_(run), visits_(build.modes.size()), begun_(build.modes.size(), 0) {
    for (const VisitIndex v : run.data->visits.indices()) {
      if (!run.IsUnconfirmed(v)) visits_[run.data->visits[v].group].push_back(v);
    }
  }

  void GoTo(Stamp stamp) {
    const auto& visits = run_.data->visits;
    for (; next_ < visits.end_index() && visits[next_].begin <= stamp; ++next_) {
      if (!run_.IsUnconfirmed(next_)) ++begun_[visits[next_].group];
    }
  }

  // How many visits of a group have begun.
  std::size_t Gap(GroupIndex group) const { return begun_[group]; }

  bool InVisit(GroupIndex group, Stamp stamp) const {
    const std::size_t gap = Gap(group);
    return gap > 0 && stamp <= run_.data->visits[visits_[group][gap - 1]].end;
  }

  // The mode at which the group was last seen, or will be seen next; kUnassigned if at none.
  OptionalMode Before(GroupIndex group) const {
    const std::size_t gap = Gap(group);
    return gap > 0 ? run_.assignment[visits_[group][gap - 1]] : kUnassigned;
  }
  OptionalMode After(GroupIndex group) const {
    const std::size_t gap = Gap(group);
    return gap < visits_[group].size() ? run_.assignment[visits_[group][gap]] : kUnassigned;
  }

 private:
  const BuildRun& run_;
  IndexedVector<GroupIndex, std::vector<VisitIndex>> visits_;
  IndexedVector<GroupIndex, std::size_t> begun_;
  VisitIndex next_;
};

// The last frame that saw each group.
using LastFrames = IndexedVector<GroupIndex, std::optional<FrameIndex>>;

// Goes through the key frames of all runs and sorts what was in view by what it tells.
class MissCollector {
 public:
  MissCollector(const BuildState& build,
                double pass_gap_s,
                const IndexedVector<ModeIndex, Visibility>& known)
      : problem_(build),
        pass_gap_(FromSeconds(pass_gap_s)),
        flat_(build),
        grid_(GridOf(build, build.sensor.max_range_m)),
        visibility_(known),
        common_(SectorOf(build.sensor)),
        seen_(flat_.count()) {
    visibility_.resize(seen_.size());
  }

  // Returns how well the run saw the modes.
  std::vector<SeenMode> AddRun(RunIndex run_index) {
    const BuildRun& run = problem_.runs[run_index];
    RunTimeline timeline(problem_, run);
    own_ = OwnSector(problem_, problem_.sensor, run);
    open_.assign(flat_.count(), {});
    LastFrames seen_at(problem_.modes.size());
    for (const FrameIndex frame : run.data->frames.indices()) {
      timeline.GoTo(run.data->frames[frame].stamp);
      if (MarkSeen(run, frame, &seen_at) > 0) AddFrame(run_index, frame, timeline, seen_at);
    }
    return TakeSeen();
  }

  const Visibility& visibility(GroupIndex group, GroupModeIndex mode) const {
    return visibility_[flat_.Index(group, mode)];
  }
  const std::map<GapRef, std::map<GroupModeIndex, MissedMode>>& gaps() const { return gaps_; }

 private:
  // Marks the groups that a frame saw where the map has them; returns their number.
  int MarkSeen(const BuildRun& run, FrameIndex frame, LastFrames* seen_at) const {
    int seen = 0;
    for (const SightingIndex s : run.data->frames[frame].sightings()) {
      const Sighting& sighting = run.data->sightings[s];
      if (!IsInlier(problem_, run, sighting)) continue;
      std::optional<FrameIndex>& at = (*seen_at)[run.data->visits[sighting.visit].group];
      seen += at != frame ? 1 : 0;
      at = frame;
    }
    return seen;
  }

  void AddFrame(RunIndex run_index,
                FrameIndex frame,
                const RunTimeline& timeline,
                const LastFrames& seen_at) {
    const BuildRun& run = problem_.runs[run_index];
    const Stamp stamp = run.data->frames[frame].stamp;
    const Se2& T_map_vehicle = run.poses[frame];
    const Se2 T_vehicle_map = T_map_vehicle.Inverse();
    const Eigen::Vector2d& p = T_map_vehicle.translation();
    grid_.VisitNear(p, own_.max_range_m, [&](const ModeGrid::Entry& entry) {
      const Eigen::Vector2d q = T_vehicle_map * entry.p_map_landmark;
      if (!WellInView(q, common_) || !WellInView(q, own_)) return;
      const std::size_t direction = DirectionOf(p - entry.p_map_landmark);
      const GroupIndex group(entry.group);
      const GroupModeIndex mode(entry.mode);
      const OptionalMode before = timeline.Before(group);
      const bool in_visit = timeline.InVisit(group, stamp);
      // Seen before and after, it did not leave in between.
      const bool stood = before && (in_visit || before == timeline.After(group));
      const ModeIndex flat = flat_.Index(group, mode);
      if (stood && before == mode) {
        const bool seen = seen_at[group] == frame;
        ++(seen ? seen_[flat].seen : seen_[flat].missed)[direction];
      }
      if (stood || in_visit) return;
      const GapRef gap{group, run_index, timeline.Gap(group)};
      OpenGap& open = open_[flat];
      if (open.missed == nullptr || open.gap != gap.gap) {
        open = {gap.gap, &gaps_[gap][mode]};
      }
      AddMiss(stamp, direction, open.missed);
    });
  }

  std::vector<SeenMode> TakeSeen() {
    std::vector<SeenMode> result;
    for (const GroupIndex group : problem_.modes.indices()) {
      for (const GroupModeIndex mode : problem_.modes[group].indices()) {
        const ModeIndex flat = flat_.Index(group, mode);
        if (seen_[flat] == Visibility()) continue;
        result.push_back({{group, mode}, seen_[flat]});
        visibility_[flat] += std::exchange(seen_[flat], {});
      }
    }
    return result;
  }

  void AddMiss(Stamp stamp, std::size_t direction, MissedMode* missed) const {
    if (missed->passes.empty()) missed->begin = stamp;
    if (missed->passes.empty() || stamp - missed->end > pass_gap_) missed->passes.push_back({});
    missed->end = stamp;
    ++missed->passes.back()[direction];
  }

  // The gap that a run is in, so that most scans look nothing up.
  struct OpenGap {
    std::size_t gap = 0;
    MissedMode* missed = nullptr;
  };

  const BuildState& problem_;
  Duration pass_gap_;
  FlatModes flat_;
  ModeGrid grid_;
  IndexedVector<ModeIndex, Visibility> visibility_;
  Sector common_;
  Sector own_;                                 // Of the present run.
  IndexedVector<ModeIndex, Visibility> seen_;  // What the present run adds.
  IndexedVector<ModeIndex, OpenGap> open_;     // Of the present run.
  std::map<GapRef, std::map<GroupModeIndex, MissedMode>> gaps_;
};

}  // namespace

MissedVisits FindMissedVisits(const BuildState& build,
                              double pass_gap_s,
                              const MissedDetectionOptions& options,
                              const IndexedVector<ModeIndex, Visibility>& known) {
  MissedVisits result;
  auto& by_group = result.by_group;
  by_group.resize(build.modes.size());
  MissCollector collector(build, pass_gap_s, known);
  for (const RunIndex run : build.runs.indices()) {
    result.seen_by_run.push_back(collector.AddRun(run));
  }
  for (const auto& [gap, modes] : collector.gaps()) {
    MissedVisit visit;
    visit.run = gap.run;
    visit.begin = modes.begin()->second.begin;
    visit.end = modes.begin()->second.end;
    visit.log_likelihoods = Eigen::VectorXd::Zero(std::ssize(build.modes[gap.group]) + 1);
    for (const auto& [mode, missed] : modes) {
      visit.begin = std::min(visit.begin, missed.begin);
      visit.end = std::max(visit.end, missed.end);
      visit.log_likelihoods[StateOf(mode)] = LogMissedPasses(
          missed.passes, collector.visibility(gap.group, mode), build.sensor, options);
    }
    by_group[gap.group].push_back(std::move(visit));
  }
  for (std::vector<MissedVisit>& visits : by_group) {
    std::stable_sort(visits.begin(), visits.end(), [](const auto& a, const auto& b) {
      return std::tie(a.begin, a.end) < std::tie(b.begin, b.end);
    });
  }
  return result;
}

}  // namespace shiftmap
