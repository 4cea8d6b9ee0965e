// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "mapstore/run/run.h"
#include "proto/core/status.h"

namespace shiftmap {

/// What the memory of a build grows with.
struct BuildSize {
  std::int64_t odometry_samples = 0;
  std::int64_t scans = 0;
  std::int64_t observations = 0;
  std::int64_t lidar_beams = 0;
  std::int64_t key_frames = 0;  ///< Scans with an identified landmark.

  /// What a segment of a run couples with, SchurSystem: sums over all segments of how much it
  /// is, and of the square.
  std::int64_t segment_boundary = 0;
  std::int64_t segment_pairs = 0;

  std::int64_t runs = 0;
  std::set<std::string> vehicles;
  std::int64_t landmarks = 0;         ///< Of the run that sees most.
  std::int64_t all_landmarks = 0;     ///< Sum over the runs of those that each sees.
  std::int64_t landmark_pairs = 0;    ///< Sum over the runs of the squares of those.
  std::int64_t prior_modes = 0;       ///< Of the map that the build goes on from.
  std::optional<std::int64_t> modes;  ///< Of the map that comes out, once that is known.
  std::int64_t runs_at_once = 1;      ///< That are mapped by themselves side by side.
};

/// Counts one run more. The result does not depend on the order.
void AddRun(const Run& run, BuildSize* size);

/// The same for runs that were counted.
void AddSize(const BuildSize& runs, BuildSize* size);

/// Modes that are to be expected before any run is placed: without a prior map the landmarks of the
/// run that sees most, and one for every fourth landmark of the others: most stand where they
/// stood.
std::int64_t ExpectedModes(const BuildSize& size);

/// Memory that a build of this size takes at its peak, the logs and the program included. [bytes]
/// Between 1 and 2.5 times what builds took (BuildLimits tests).
std::int64_t EstimateBuildMemory(const BuildSize& size);

/// Errors: kInvalidArgument with both figures if a build of this size takes more than
/// `max_memory_bytes`; 0 allows any.
Status CheckBuildMemory(const BuildSize& size, std::int64_t max_memory_bytes);

/// Which runs of a build stay within a bound on its memory: as many as do, from the smallest on, by
/// what each would take alone. The result does not depend on the order in which they are added.
class RunChoice {
 public:
  struct LeftOut {
    std::string id;
    std::string reason;
  };

  /// @param max_memory_bytes  At least 1. [bytes]
  /// @param threads           On which runs are mapped by themselves.
  RunChoice(std::int64_t max_memory_bytes, std::int64_t prior_modes, int threads)
      : max_memory_bytes_(max_memory_bytes), prior_modes_(prior_modes), threads_(threads) {}

  /// Adds a run and returns the runs that are too much, itself maybe among them.
  /// @param id    Of the run, unique; orders runs of one size.
  /// @param size  Of it alone.
  std::vector<LeftOut> Add(const std::string& id, const BuildSize& size);

  /// Takes back a run that was added. What was left out beside it stays so.
  void Remove(const std::string& id);

 private:
  using Key = std::pair<std::int64_t, std::string>;  // What it takes alone, and its id.

  BuildSize Total() const;

  std::int64_t max_memory_bytes_;
  std::int64_t prior_modes_;
  int threads_;
  std::map<Key, BuildSize> kept_;
  std::optional<Key> first_left_out_;  // Everything from there on is left out.
};

}  // namespace shiftmap
