// SPDX-License-Identifier: Apache-2.0
#include "mapper/modes/mode_merging.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "mapper/state/sightings.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/map/edited_map.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

bool InPrior(const BuildMode& mode) { return mode.number != kAbsent; }

// Everything discrete of a group.
std::vector<int> GroupState(const BuildState& build,
                            const std::vector<VisitRef>& visits,
                            GroupIndex group) {
  std::vector<int> state = {static_cast<int>(build.modes[group].size())};
  for (const VisitRef& ref : visits) {
    state.push_back(StateOf(AssignmentOf(build, ref)));
  }
  return state;
}

// Moves every assignment of a group from one mode to another.
void Reassign(const std::vector<VisitRef>& visits,
              GroupModeIndex from,
              OptionalMode to,
              BuildState* build) {
  for (const VisitRef& ref : visits) {
    OptionalMode& assignment = AssignmentOf(build, ref);
    if (assignment == from) assignment = to;
  }
}

// Removes a mode; later modes of the group and of the prior's flat list move up.
void EraseMode(const std::vector<VisitRef>& visits,
               GroupIndex group,
               GroupModeIndex mode,
               BuildState* build) {
  if (!build->priors.empty()) {
    const ModeIndex flat = FlatModes(*build).Index(group, mode);
    ShiftPriors(flat + 1, -1, &build->priors);
  }
  build->modes[group].erase(build->modes[group].begin() + mode.value());
  for (const VisitRef& ref : visits) {
    OptionalMode& assignment = AssignmentOf(build, ref);
    if (assignment > mode) assignment = *assignment - 1;
  }
}

// True if two modes i and j, `difference` apart, are not known to be one place.
bool ToldApart(const ModeOptions& options,
               const Eigen::Vector2d& difference,
               ModeIndex i,
               ModeIndex j,
               const ModeDifferences& differences) {
  const double floor = 2.0 * options.position_floor_m * options.position_floor_m;
  const double gate = ChiSquareQuantile(options.merge_probability, 2);
  const auto unknown = [&](const Eigen::Matrix2d& cov) {
    return 0.5 * cov.trace() > options.max_merge_sd_m * options.max_merge_sd_m;
  };
  const auto apart_by = [&](const Eigen::Matrix2d& cov) {
    return SquaredMahalanobis(difference, cov + floor * Eigen::Matrix2d::Identity()) > gate;
  };
  // What the least or the largest covariance there can be decides needs no other.
  const Eigen::Matrix2d least = differences.MinCovariance(i, j);
  const Eigen::Matrix2d most = differences.MaxCovariance(i, j);
  if (unknown(least) || apart_by(most)) return true;
  if (!unknown(most) && !apart_by(least)) return false;
  const Eigen::Matrix2d cov = differences.Covariance(i, j);
  return unknown(cov) || apart_by(cov);
}

// True if a mode was displaced from those of the prior map. Where that has several of a landmark, a
// run by itself may have had one between them: that is displaced while it is nearer to there.
bool IsDisplaced(const BuildMode& mode, const BuildMode& of_prior, const GroupModes& modes) {
  if (!mode.displaced_to) return false;
  return std::count_if(modes.begin(), modes.end(), InPrior) < 2 ||
         (mode.p_map_landmark - *mode.displaced_to).norm() <
             (mode.p_map_landmark - of_prior.p_map_landmark).norm();
}

// @param rows  Of a and b in the covariance of their map.
bool AreOnePlace(const ModeOptions& options,
                 const Mode& a,
                 const Mode& b,
                 const std::vector<int>& rows,
                 const JointCovariance& covariance) {
  const double near = options.position_floor_m;
  const Eigen::Vector2d difference = a.p_map_landmark - b.p_map_landmark;
  const bool stated = a.last_seen == Stamp() || b.last_seen == Stamp();
  if (stated || difference.norm() > near) return false;
  const Eigen::Matrix4d cov = covariance.Dense(rows);
  const Eigen::Matrix2d of_difference = cov.topLeftCorner<2, 2>() + cov.bottomRightCorner<2, 2>() -
                                        cov.topRightCorner<2, 2>() - cov.bottomLeftCorner<2, 2>();
  return 0.5 * of_difference.trace() <= near * near &&
         SquaredMahalanobis(difference, of_difference) <=
             ChiSquareQuantile(options.merge_probability, 2);
}

// The next merge in a prior map, or nothing.
std::optional<MapEdit> FindMergeOfPrior(const ModeOptions& options,
                                        const std::set<Signature>& except,
                                        const MapContent& prior) {
  int row = 0;  // Of mode b in the covariance.
  for (const LandmarkGroup& group : prior.groups) {
    for (auto b = group.modes.begin(); b != group.modes.end(); ++b, ++row) {
      for (auto a = group.modes.begin(); a != b && !except.contains(group.signature); ++a) {
        const int row_a = row - static_cast<int>(b - a);
        if (!AreOnePlace(options, *a, *b, {row_a, row}, prior.covariance)) continue;
        const bool a_stays = a->cov_p_map_landmark.trace() <= b->cov_p_map_landmark.trace();
        MapEdit merge;
        merge.kind = EditKind::kMerge;
        merge.landmark = group.signature;
        merge.into = a_stays ? a->number : b->number;
        merge.mode = a_stays ? b->number : a->number;
        return merge;
      }
    }
  }
  return std::nullopt;
}

void ApplyMerges(const IndexedVector<GroupIndex, std::vector<VisitRef>>& by_group,
                 const std::vector<ModeMerge>& merges,
                 BuildState* build) {
  for (const ModeMerge& merge : merges) {
    Reassign(by_group[merge.group], merge.from, merge.to, build);
  }
  DropUnusedModes(build);
}

}  // namespace

std::vector<ModeMerge> FindMerges(const ModeOptions& options,
                                  const ModeDifferences& differences,
                                  const BuildState& build) {
  const FlatModes flat(build);
  std::vector<ModeMerge> merges;
  for (const GroupIndex group : build.modes.indices()) {
    const GroupModes& modes = build.modes[group];
    IndexedVector<GroupModeIndex, bool> gone(modes.size());
    for (const GroupModeIndex a : modes.indices()) {
      for (GroupModeIndex b = a + 1; b < modes.end_index(); ++b) {
        if (gone[a] || gone[b] || InPrior(modes[b])) continue;
        if (InPrior(modes[a]) && IsDisplaced(modes[b], modes[a], modes)) continue;
        const Eigen::Vector2d difference = modes[a].p_map_landmark - modes[b].p_map_landmark;
        const ModeIndex i = flat.Index(group, a);
        const ModeIndex j = flat.Index(group, b);
        if (ToldApart(options, difference, i, j, differences)) continue;
        merges.push_back({group, a, b});
        gone[b] = true;
      }
    }
  }
  return merges;
}

int MergeModesOfPrior(const ModeOptions& options,
                      const std::set<Signature>& except,
                      MapContent* prior) {
  int merges = 0;
  while (const std::optional<MapEdit> merge = FindMergeOfPrior(options, except, *prior)) {
    EditedMap merged(std::move(*prior), {});
    const Status applied = merged.Apply(*merge);
    SHIFTMAP_CHECK(applied.ok(), "'{}': {}", merge->landmark.text(), Message(applied));
    *prior = merged.content();
    ++merges;
  }
  return merges;
}

MergeMemory::MergeMemory(const BuildState& build)
    : by_group_(VisitsByGroup(build)), merged_(by_group_.size()) {}

void MergeMemory::Merge(const std::vector<ModeMerge>& merges, BuildState* build) {
  std::map<GroupIndex, std::vector<ModeMerge>> of_groups;
  for (const ModeMerge& merge : merges) of_groups[merge.group].push_back(merge);
  for (const auto& [group, of_group] : of_groups) {
    merged_[group][GroupState(*build, by_group_[group], group)] = of_group;
  }
  ApplyMerges(by_group_, merges, build);
}

void MergeMemory::MergeAgain(BuildState* build) const {
  std::vector<ModeMerge> merges;
  for (const GroupIndex group : by_group_.indices()) {
    if (merged_[group].empty()) continue;
    const auto found = merged_[group].find(GroupState(*build, by_group_[group], group));
    if (found == merged_[group].end()) continue;
    merges.insert(merges.end(), found->second.begin(), found->second.end());
  }
  ApplyMerges(by_group_, merges, build);
}

void DropUnusedModes(BuildState* build) {
  const auto by_group = VisitsByGroup(*build);
  for (const GroupIndex group : build->modes.indices()) {
    for (GroupModeIndex mode = build->modes[group].end_index(); mode > 0;) {
      mode = mode - 1;
      const bool used =
          std::any_of(by_group[group].begin(), by_group[group].end(), [&](const VisitRef& ref) {
            return AssignmentOf(build, ref) == mode;
          });
      if (used || InPrior(build->modes[group][mode])) continue;
      EraseMode(by_group[group], group, mode, build);
    }
  }
}

int DropUnsupportedModes(const ModeOptions& options, BuildState* build) {
  const auto by_group = VisitsByGroup(*build);
  int dropped = 0;
  for (const GroupIndex group : build->modes.indices()) {
    for (GroupModeIndex mode = build->modes[group].end_index(); mode > 0;) {
      mode = mode - 1;
      std::ptrdiff_t sightings = 0;
      for (const VisitRef& ref : by_group[group]) {
        if (AssignmentOf(build, ref) == mode) sightings += CountInliers(*build, ref);
      }
      if (sightings >= options.min_sightings || InPrior(build->modes[group][mode])) {
        continue;
      }
      Reassign(by_group[group], mode, kUnassigned, build);
      EraseMode(by_group[group], group, mode, build);
      ++dropped;
    }
  }
  return dropped;
}

BuildState RunByItself(const BuildState& build, RunIndex run) {
  BuildState alone;
  alone.sensor = build.sensor;
  alone.modes = build.modes;
  alone.in_map_units = TellsScales(build);
  for (GroupModes& group : alone.modes) {
    for (BuildMode& mode : group) mode.number = kAbsent;
  }
  alone.runs.push_back(build.runs[run]);
  DropUnusedModes(&alone);
  return alone;
}

}  // namespace shiftmap
