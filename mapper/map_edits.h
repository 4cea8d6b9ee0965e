// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <set>
#include <vector>

#include "mapper/mapper.h"
#include "mapper/mapper_input.h"
#include "mapper/mapper_options.h"
#include "mapstore/core/ids.h"
#include "mapstore/map/control_points.h"
#include "mapstore/map/map_edit.h"

namespace shiftmap {

/// What the edits of a prior map mean for a build on it.
struct BuildEdits {
  std::map<Signature, Signature> aliases;  ///< Former names, each with the map's.
  std::set<Signature> retired;  ///< By the map's names: what logs see of them is ignored.
  std::vector<ControlPoint> control_points;
  std::map<Signature, StatedRate> rates;

  /// Landmarks whose rates somebody stated, be it taken back: their chains are learned anew.
  std::set<Signature> relearned;

  std::vector<EditId> undone_rates;  ///< That nothing rests on once they are.
};

/// @param held  The edits that the prior map holds, by id.
BuildEdits MakeBuildEdits(const std::vector<MapEdit>& held);

/// Landmarks of which somebody stated where a mode is, or that two modes are two places: by a
/// split, or a merge that was taken back.
/// @param edits  Of the area, also those that no map holds.
/// @param held   Edits that the map holds, by id: landmarks have their names.
std::set<Signature> StatedPlaces(const std::vector<MapEdit>& edits,
                                 const std::vector<MapEdit>& held);

/// Gives what logs saw the map's names, and leaves out what was retired.
void FollowEdits(const BuildEdits& edits, std::vector<MapperInput>* inputs);

/// Adds what is stated about rates to the options.
void StateRates(const BuildEdits& edits, ChainOptions* options);

/// Moves a map that was built on the control points, which the prior map's covariance knows of, to
/// where they say, those that contradict it left out (FittingControlPoints); its runs move with the
/// frame.
void HoldControlPoints(const BuildEdits& edits, MapperResult* result);

}  // namespace shiftmap
