// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "mapstore/core/ids.h"
#include "proto/core/status.h"
#include "tools/sim/simulated_world.h"

namespace shiftmap {

/// How far a map and its trajectories are from the truth, after rigid alignment of the map with the
/// places that were seen. Sums, so that sites add up.
struct EngineScore {
  int modes = 0;            ///< Of the map.
  int groups_right = 0;     ///< Landmarks without a mode that is missing or spurious.
  int missing = 0;          ///< Places with four sightings in a visit, without a mode within 0.5 m.
  int spurious = 0;         ///< Modes without a place within 0.5 m.
  int matched = 0;          ///< The other modes;
  double squared_m2 = 0.0;  ///< their squared distances from their places,
  double squared_deviations = 0.0;   ///< and the same in standard deviations of the map.
  int poses = 0;                     ///< Of all trajectories, at scans that saw something;
  double squared_of_poses_m2 = 0.0;  ///< their squared distances from the truth.
  double processor_s = 0.0;          ///< Of the build.
  double wall_s = 0.0;               ///< The same by the clock on the wall.
  int left_out = 0;                  ///< Runs.

  void Add(const EngineScore& other);
};

/// How far the map of the graph engine is from that of the tree engine, after rigid alignment of
/// the two. Sums. A difference is in standard deviations of the tree's map.
struct EngineDifference {
  int groups = 0;            ///< Landmarks that were seen four times in a visit, or have a mode.
  int same_number = 0;       ///< Of these: with as many modes in both maps.
  int matched = 0;           ///< Modes within 0.5 m of each other;
  double squared_m2 = 0.0;   ///< their squared distances,
  int axes_within_sd = 0;    ///< coordinates (two per mode) that differ by one deviation at most,
  int within_ellipse39 = 0;  ///< those inside the ellipse of 39.3 %, one standard deviation,
  int within_ellipse95 = 0;  ///< and of 95 %.

  void Add(const EngineDifference& other);
};

/// Both engines on one site, or on several.
struct EnginesRow {
  std::string kind;
  std::uint64_t seed = 0;
  int runs = 0;
  EngineDifference difference;
  EngineScore graph;
  EngineScore tree;

  void Add(const EnginesRow& other);
};

/// A landmark whose numbers of modes are not those of the truth in both maps, or that has a mode
/// outside of the ellipse of 95 %.
struct EnginesException {
  std::string kind;
  std::uint64_t seed = 0;
  Signature signature;
  int graph_modes = 0;
  int tree_modes = 0;
  int true_modes = 0;       ///< Places with four sightings in a visit.
  int seen_places = 0;      ///< Places with one.
  double apart_m = 0.0;     ///< Largest distance of matched modes. [m]
  double deviations = 0.0;  ///< The largest in standard deviations.
};

struct EnginesResult {
  std::vector<EnginesRow> sites;
  std::vector<EnginesException> exceptions;
};

/// Kinds of sites: floors of 20 landmarks on 25 to 40 m that change little or much, one with false
/// alarms and landmarks that are away, one of 60 landmarks, and a mine whose tags have signatures.
const std::vector<std::string>& EngineSiteKinds();

/// Errors: kInvalidArgument for a kind that there is not.
StatusOr<SimulatedWorld> DrawEngineSite(const std::string& kind, std::uint64_t seed);

struct EnginesOptions {
  std::vector<std::string> kinds = EngineSiteKinds();
  int sites = 2;  ///< Of each kind. > 0.
  std::uint64_t seed = 1;
};

/// Builds one map of each site by BuildMap() and one by BuildMapByTree(), with default options but
/// for the scale of sensors, which simulated ones have right.
Status CompareEngines(const std::string& kind,
                      std::uint64_t seed,
                      const SimulatedWorld& world,
                      EnginesResult* result);

/// The same for all sites. @param progress  Called with the share that is done.
StatusOr<EnginesResult> RunEngines(const EnginesOptions& options,
                                   const std::function<void(double)>& progress);

}  // namespace shiftmap
