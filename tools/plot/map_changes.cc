// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/map_changes.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "mapstore/map/map_diff.h"
#include "tools/plot/landmark_layer.h"

namespace shiftmap {
namespace {

constexpr double kChance = 0.01;  // Of a move at least as large, if nothing moved.
constexpr double kLeastProbabilityChange = 0.1;

using Groups = std::map<Signature, const LandmarkGroup*>;

Groups BySignature(const MapContent& content) {
  Groups groups;
  for (const LandmarkGroup& group : content.groups) groups[group.signature] = &group;
  return groups;
}

const Mode& ModeOf(const LandmarkGroup& group, ModeNumber number) {
  return group.modes[static_cast<std::size_t>(group.StateOf(number)) - 1];
}

double ProbabilityOf(const LandmarkGroup& group, ModeNumber number) {
  const int state = group.StateOf(number);
  return state < 0 ? 0.0 : group.probabilities(state);
}

class Finder {
 public:
  Finder(const MapContent& from, const MapContent& to)
      : from_(BySignature(from)), to_(BySignature(to)) {}

  MapChanges Find(const MapDiff& diff) {
    for (const Signature& signature : diff.groups_added) {
      AddWhole(ChangeKind::kNewLandmark, *to_.at(signature), "new");
    }
    for (const Signature& signature : diff.groups_removed) {
      AddWhole(ChangeKind::kGoneLandmark, *from_.at(signature), "gone");
    }
    for (const GroupDiff& group : diff.groups) {
      AddModes(group);
      AddStanding(group);
    }
    std::stable_sort(found_.changes.begin(),
                     found_.changes.end(),
                     [](const MapChange& a, const MapChange& b) { return a.kind < b.kind; });
    for (const MapChange& change : found_.changes) {
      ++found_.counts[static_cast<std::size_t>(change.kind)];
    }
    return std::move(found_);
  }

 private:
  void Add(ChangeKind kind,
           const Signature& signature,
           const Eigen::Vector2d& from,
           const Eigen::Vector2d& to,
           std::string detail) {
    found_.changes.push_back({kind, signature, from, to, std::move(detail)});
  }

  void AddWhole(ChangeKind kind, const LandmarkGroup& group, const std::string& detail) {
    if (group.modes.empty()) return;
    const Eigen::Vector2d at = group.modes[MainMode(group)].p_map_landmark;
    Add(kind, group.signature, at, at, detail);
  }

  void AddModes(const GroupDiff& diff) {
    const LandmarkGroup& from = *from_.at(diff.signature);
    const LandmarkGroup& to = *to_.at(diff.signature);
    for (const ModeNumber number : diff.added) {
      const Eigen::Vector2d at = ModeOf(to, number).p_map_landmark;
      Add(ChangeKind::kNewMode, diff.signature, at, at, fmt::format("new m{}", number.value()));
    }
    for (const ModeNumber number : diff.removed) {
      const Eigen::Vector2d at = ModeOf(from, number).p_map_landmark;
      Add(ChangeKind::kGoneMode, diff.signature, at, at, fmt::format("m{} gone", number.value()));
    }
    for (const MergedMode& merged : diff.merged) {
      if (from.StateOf(merged.number) < 1 || to.StateOf(merged.into) < 1) continue;
      Add(ChangeKind::kMergedMode,
          diff.signature,
          ModeOf(from, merged.number).p_map_landmark,
          ModeOf(to, merged.into).p_map_landmark,
          fmt::format("m{} into m{}", merged.number.value(), merged.into.value()));
    }
    for (const MovedMode& moved : diff.moved) {
      if (moved.p_value >= kChance) {
        ++found_.small_moves;
        continue;
      }
      const Eigen::Vector2d at = ModeOf(to, moved.number).p_map_landmark;
      Add(ChangeKind::kMovedEstimate,
          diff.signature,
          at - moved.displacement_m,
          at,
          fmt::format("m{} by {:.2g} m", moved.number.value(), moved.displacement_m.norm()));
    }
  }

  // Whether the newest changes, those of one landmark, have a new mode there; its label is then
  // that of the move.
  bool TakeLabelOfNewMode(const Signature& signature, const Eigen::Vector2d& at) {
    for (auto change = found_.changes.rbegin();
         change != found_.changes.rend() && change->signature == signature;
         ++change) {
      if (change->kind != ChangeKind::kNewMode || change->p_to != at) continue;
      change->detail.clear();
      return true;
    }
    return false;
  }

  // Where the landmark stands, or how sure that is.
  void AddStanding(const GroupDiff& diff) {
    const LandmarkGroup& from = *from_.at(diff.signature);
    const LandmarkGroup& to = *to_.at(diff.signature);
    if (from.modes.empty() || to.modes.empty()) return;
    const Mode& before = from.modes[MainMode(from)];
    const Mode& after = to.modes[MainMode(to)];
    const Eigen::Vector2d& p_before = before.p_map_landmark;
    const Eigen::Vector2d& p_after = after.p_map_landmark;
    if (IsLikelyAbsent(to) != IsLikelyAbsent(from)) {
      const bool left = IsLikelyAbsent(to);
      const Eigen::Vector2d& at = left ? p_before : p_after;
      Add(left ? ChangeKind::kLeft : ChangeKind::kCameBack,
          diff.signature,
          at,
          at,
          fmt::format("absent {} to {}",
                      PercentText(from.probabilities(0)),
                      PercentText(to.probabilities(0))));
      return;
    }
    const bool same = from.CarriedStateOf(after.number) == from.StateOf(before.number) ||
                      to.CarriedStateOf(before.number) == to.StateOf(after.number);
    if (!same && !IsLikelyAbsent(to)) {
      const bool is_new = TakeLabelOfNewMode(diff.signature, p_after);
      Add(ChangeKind::kStandsElsewhere,
          diff.signature,
          p_before,
          p_after,
          fmt::format("m{} to {}m{}, {}",
                      before.number.value(),
                      is_new ? "new " : "",
                      after.number.value(),
                      PercentText(ProbabilityOf(to, after.number))));
    } else if (diff.probability_change > kLeastProbabilityChange) {
      Add(ChangeKind::kProbability,
          diff.signature,
          p_after,
          p_after,
          fmt::format("m{} {} to {}",
                      after.number.value(),
                      PercentText(ProbabilityOf(from, after.number)),
                      PercentText(ProbabilityOf(to, after.number))));
    }
  }

  Groups from_;
  Groups to_;
  MapChanges found_;
};

}  // namespace

MapChanges FindChanges(const MapContent& from, const MapContent& to) {
  return Finder(from, to).Find(DiffMaps(from, to));
}

}  // namespace shiftmap
