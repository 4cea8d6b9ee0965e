// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "mapstore/map/control_points.h"
#include "mapstore/map/landmark_group.h"
#include "mapstore/map/map_edit.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/map/vehicle_calibration.h"
#include "proto/core/status.h"

namespace shiftmap {

/// The control points among edits that hold, by the names that landmarks have under all of them.
/// One whose mode another of these edits merged is none: the position is not that of the mode which
/// took it over.
std::vector<ControlPoint> ControlPointsOf(const std::vector<MapEdit>& held);

/// A map while edits are made in it and taken out of it.
class EditedMap {
 public:
  /// @param held  The edits that the content is made with, by id.
  EditedMap(MapContent content, std::vector<MapEdit> held);

  const MapContent& content() const { return content_; }
  const std::vector<MapEdit>& held() const { return held_; }
  const LandmarkNames& names() const { return names_; }

  /// The landmark of an edit, or null.
  const LandmarkGroup* GroupOf(const MapEdit& edit) const;

  /// Sets what an edit leaves open: the number of a mode that it adds, the mode of a control point.
  /// Errors: kNotFound without the landmark; kInvalidArgument if two modes are about as near to the
  /// control point.
  Status Complete(MapEdit* edit) const;

  /// Errors: kNotFound if the map does not have the landmark, mode or vehicle; kInvalidArgument if
  /// it cannot be done, as a rename to a name that is taken.
  /// @param kept  Of kCalibration: what holds instead; nothing: the fleet's calibration.
  Status Apply(const MapEdit& edit, const std::optional<VehicleCalibration>& kept = std::nullopt);

  /// Whether the control points fit the map, and with one that is to come.
  /// Errors: as CheckControlPoints.
  Status CheckPoints() const { return CheckControlPoints(ControlPointsOf(held_), content_); }
  Status CheckPointsWith(const MapEdit& control) const;

  /// Keeps the number of a mode that an edit had added and that is taken back: no other gets it. To
  /// be at a new mode is to be at no known position, to be at a mode's second place is to be at it.
  void Reserve(const MapEdit& taken_back);

  /// Whether an edit can be taken out of the map, although runs were added since. Positions and
  /// rates that runs were mapped with cannot.
  bool IsReversible(const MapEdit& edit) const;

  /// Whether an edit takes something away, which only the map before it still has.
  static bool TakesAway(const MapEdit& edit) {
    return edit.kind == EditKind::kRetire || edit.kind == EditKind::kMerge ||
           edit.kind == EditKind::kCalibration;
  }

  /// Takes an edit out. What it took away comes back as it was before, in the frame of now; how it
  /// correlates with what was built since is not known, and counts as not at all. A merged mode at
  /// whose place builds made another one since does not come back: the other one stands for it.
  /// @param before  The map that the edit was made on; any map unless it TakesAway().
  /// Precondition: IsReversible.
  Status Reverse(const MapEdit& edit, const EditedMap& before);

 private:
  Status ApplyTo(const MapEdit& edit, const std::optional<VehicleCalibration>& kept);
  EditedMap InFrameOf(const EditedMap& later) const;

  MapContent content_;
  std::vector<MapEdit> held_;
  LandmarkNames names_;
};

}  // namespace shiftmap
