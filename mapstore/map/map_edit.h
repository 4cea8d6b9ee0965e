// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/core/stamp.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Numbers the edits of a store, from 1, in the order they were made.
using EditId = Id<struct EditIdTag>;

enum class EditKind {
  kPosition,     ///< A mode is at a surveyed position; its correlations go.
  kNewMode,      ///< A mode that no run has seen.
  kControl,      ///< Control point: the map is moved to it, and every later build again.
  kRetire,       ///< The landmark is no more: it leaves the map, and builds ignore it.
  kRename,       ///< The landmark has another name, in logs and rows too.
  kMerge,        ///< A mode is the same position as another one.
  kSplit,        ///< A mode is two positions.
  kRate,         ///< A prior of the leave rate.
  kCalibration,  ///< What is known of a vehicle since a time is forgotten.
};

/// As the store writes it: "position", "new_mode", …
const char* NameOf(EditKind kind);

/// The kind of that name, or nothing.
std::optional<EditKind> EditKindNamed(const std::string& name);

/// An edit that was taken back.
struct EditUndo {
  std::string author;
  std::string reason;
  Stamp when;
};

/// What a person says of a landmark or a vehicle: a prior statement, which map versions are made
/// with. Members that the kind does not use stay as they are here.
struct MapEdit {
  EditKind kind = EditKind::kPosition;
  std::string author;
  std::string reason;

  Signature signature;  ///< The landmark, by its name when the edit was made.

  /// Of kPosition, kNewMode, kControl; of kMerge the mode that goes, of kSplit the one that is
  /// split. The store gives a new mode its number; of a control point, 0 is the mode nearest to it.
  ModeNumber mode;

  /// Of kMerge: the mode that stands for the other one. Of kSplit: the mode of the second place,
  /// numbered by the store.
  ModeNumber into;
  Signature new_name;  ///< Of kRename.

  /// Of kPosition, kNewMode, kControl, kSplit. Map frame [m]; standard deviation per axis [m].
  Eigen::Vector2d p_map_landmark = Eigen::Vector2d::Zero();
  double sd_m = 0.0;

  /// Of kSplit: the second place, with the same standard deviation. Map frame. [m]
  Eigen::Vector2d p_map_second = Eigen::Vector2d::Zero();

  /// Of kSplit: runs (RunRecord::identity) that met the landmark at the first place, and at the
  /// second. What other runs tell of the mode counts for both.
  std::vector<std::string> first_runs;
  std::vector<std::string> second_runs;

  double rate_per_s = 0.0;  ///< Of kRate. [1/s]
  double weight = 0.0;      ///< Of kRate: counts as so many jumps, in weight / rate seconds.

  std::string vehicle;  ///< Of kCalibration.
  Stamp since;          ///< Of kCalibration: what runs tell that end then or later.

  // Set by the store.
  EditId id;
  Stamp made;
  Signature landmark;                    ///< The name before all renames that held then.
  double evidence_s = 0.0;               ///< Of kRate: from the first visit to the last, then. [s]
  std::optional<VersionNumber> version;  ///< Made with it first; nothing if it changed none yet.
  std::optional<EditUndo> undone;        ///< Nothing unless it was taken back.
  std::optional<VersionNumber> kept = {};  ///< Of kCalibration: whose values hold instead.
};

/// Checks what does not take a map: texts, numbers, and that names are printable.
/// Errors: kInvalidArgument naming the member.
Status ValidateEdit(const MapEdit& edit);

/// Author and reason. Errors: kInvalidArgument.
Status ValidateUndo(const EditUndo& undo);

/// The names of landmarks under the renames that hold in a map version.
class LandmarkNames {
 public:
  LandmarkNames() = default;

  /// @param held  Edits that hold, by id; others than renames are left out.
  explicit LandmarkNames(const std::vector<MapEdit>& held);

  /// A later rename.
  void Add(const MapEdit& rename);

  /// The name before all renames.
  Signature Landmark(const Signature& name) const;

  /// The name after all renames.
  Signature Name(const Signature& landmark) const;

  /// All names that are not the last, each with the last.
  std::map<Signature, Signature> Aliases() const;

 private:
  std::map<Signature, Signature> landmarks_;  // By every name that a rename gave.
  std::map<Signature, Signature> names_;      // The last name, by landmark.
};

}  // namespace shiftmap
