// SPDX-License-Identifier: Apache-2.0
#include "mapper/map_edits.h"

#include "mapstore/map/edited_map.h"
#include "mapstore/map/frame_change.h"

namespace shiftmap {
namespace {

// Whether an edit says where modes of its landmark are, as long as it holds.
bool StatesPlaces(const MapEdit& edit) {
  switch (edit.kind) {
    case EditKind::kPosition:
    case EditKind::kNewMode:
    case EditKind::kControl:
    case EditKind::kSplit:
      return !edit.undone;
    case EditKind::kMerge:
      return edit.undone.has_value();
    default:
      return false;
  }
}

}  // namespace

BuildEdits MakeBuildEdits(const std::vector<MapEdit>& held) {
  const LandmarkNames names(held);
  BuildEdits edits;
  edits.aliases = names.Aliases();
  std::vector<MapEdit> in_force;
  for (const MapEdit& edit : held) {
    const Signature name = names.Name(edit.landmark);
    if (edit.kind == EditKind::kRate) edits.relearned.insert(name);
    if (edit.kind == EditKind::kRate && edit.undone) edits.undone_rates.push_back(edit.id);
    // What names and numbers mean does not change before the map does.
    const bool names_modes = edit.kind == EditKind::kRename || edit.kind == EditKind::kMerge;
    if (edit.undone && !names_modes) continue;
    in_force.push_back(edit);
    if (edit.kind == EditKind::kRetire) edits.retired.insert(name);
    if (edit.kind == EditKind::kRate) {
      StatedRate& rate = edits.rates[name];
      rate.jumps += edit.weight;
      rate.seconds += edit.weight / edit.rate_per_s;
    }
  }
  edits.control_points = ControlPointsOf(in_force);
  return edits;
}

std::set<Signature> StatedPlaces(const std::vector<MapEdit>& edits,
                                 const std::vector<MapEdit>& held) {
  const LandmarkNames names(held);
  std::set<Signature> landmarks;
  for (const MapEdit& edit : edits) {
    if (StatesPlaces(edit)) landmarks.insert(names.Name(edit.landmark));
  }
  return landmarks;
}

void FollowEdits(const BuildEdits& edits, std::vector<MapperInput>* inputs) {
  if (edits.aliases.empty() && edits.retired.empty()) return;
  for (MapperInput& input : *inputs) {
    for (Scan& scan : input.run.scans) {
      std::erase_if(scan.observations, [&](Observation& observation) {
        const auto alias = edits.aliases.find(observation.signature);
        if (alias != edits.aliases.end()) observation.signature = alias->second;
        return edits.retired.contains(observation.signature);
      });
    }
  }
}

void StateRates(const BuildEdits& edits, ChainOptions* options) {
  options->learning.stated = edits.rates;
  options->relearned = edits.relearned;
}

void HoldControlPoints(const BuildEdits& edits, MapperResult* result) {
  if (edits.control_points.empty() || result->runs.empty()) return;
  const std::vector<ControlPoint> points =
      FittingControlPoints(edits.control_points, result->content);
  const Se2 T_new_old = HoldControlPoints(points, points.size(), &result->content);
  for (MappedRun& run : result->runs) {
    run.T_map_start = T_new_old * run.T_map_start;
    MoveTrajectory(T_new_old, &run.trajectory);
  }
}

}  // namespace shiftmap
