// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "tests/scenario/command.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {

/// Simulated shifts in a folder of their own, made by shiftmap-sim open.
class World {
 public:
  /// @param options  Of shiftmap-sim open, beside the folder.
  explicit World(const Arguments& options);

  /// Path of a run's log, true trajectory, and the places where its landmarks stood.
  std::string Log(int run) const { return Name(run) + ".mcap"; }
  std::string Truth(int run) const { return Name(run) + ".truth.tum"; }

  /// Every place of every landmark.
  std::string Places() const { return folder_.File("truth.csv"); }

  /// The mode of the truth that held in a run, by signature in the file's order; 0 if away.
  struct TrueMode {
    std::string signature;
    int mode = 0;
  };
  std::vector<TrueMode> Modes(int run) const;

  /// Arguments of a build of runs as area "floor" into a store beside them.
  Arguments BuildOf(const std::string& store, const std::vector<int>& runs) const;

  /// A path beside the runs.
  std::string File(const std::string& name) const { return folder_.File(name); }

 private:
  std::string Name(int run) const;

  TempDir folder_;
};

/// Options of a site where two in five of 20 landmarks move between shifts: four shifts of 2 min.
Arguments RestlessSite(int seed);

/// Rows of a CSV file without quotes, its header left out. Aborts if it cannot be read.
std::vector<std::vector<std::string>> ReadCsv(const std::string& path);

}  // namespace shiftmap::testing
