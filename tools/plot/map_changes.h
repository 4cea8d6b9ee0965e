// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "mapstore/map/map_snapshot.h"

namespace shiftmap {

/// Kinds of changes, the most important first.
enum class ChangeKind {
  kStandsElsewhere,  ///< Another mode is the most probable one.
  kLeft,             ///< Likely absent, and was not.
  kCameBack,         ///< Was likely absent.
  kNewLandmark,
  kGoneLandmark,  ///< No longer in the map.
  kNewMode,
  kGoneMode,
  kMergedMode,
  kMovedEstimate,  ///< The estimate of a mode, by more than chance does.
  kProbability,    ///< Other changes of probability above 10 %.
};
inline constexpr std::size_t kChangeKinds = 10;

/// A change that a picture shows.
struct MapChange {
  ChangeKind kind;
  Signature signature;
  Eigen::Vector2d p_from = Eigen::Vector2d::Zero();  ///< Of an arrow, where it begins. [m]
  Eigen::Vector2d p_to = Eigen::Vector2d::Zero();    ///< Where it is shown. Map frame. [m]
  std::string detail;  ///< `m1 to m2`, `62 to 97 %`; empty: another has it.
};

struct MapChanges {
  std::vector<MapChange> changes;  ///< By kind, then signature.
  std::array<int, kChangeKinds> counts = {};
  int small_moves = 0;  ///< Estimates that moved no more than chance does.
};

/// What changed from one map to another, by signature and mode number.
MapChanges FindChanges(const MapContent& from, const MapContent& to);

}  // namespace shiftmap
