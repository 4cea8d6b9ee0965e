// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/world_files.h"

#include "mapstore/codec/run_log.h"
#include "mapstore/core/atomic_file.h"
#include "mapstore/core/csv.h"
#include "mapstore/core/folder.h"

namespace shiftmap {
namespace {

constexpr const char* kPlacesHeader = "signature,mode,x_m,y_m\n";

std::string PlaceRow(const SimulatedGroup& group, ModeNumber mode) {
  const Eigen::Vector2d& p = group.modes[static_cast<std::size_t>(mode.value() - 1)];
  return fmt::format("{},{},{},{}\n", CsvText(group.signature.text()), mode.value(), p.x(), p.y());
}

}  // namespace

StatusOr<std::vector<std::string>> WriteWorld(const SimulatedWorld& world,
                                              const std::string& directory) {
  SHIFTMAP_RETURN_IF_ERROR(MakeFolder(directory));
  std::string truth = kPlacesHeader;
  for (const SimulatedGroup& group : world.groups) {
    for (std::size_t i = 0; i < group.modes.size(); ++i) {
      truth += PlaceRow(group, ModeNumber(static_cast<std::int64_t>(i + 1)));
    }
  }
  SHIFTMAP_RETURN_IF_ERROR(WriteFileAtomically(directory + "/truth.csv", truth));
  std::string modes = "run,signature,mode\n";
  std::vector<std::string> paths;
  for (std::size_t r = 0; r < world.runs.size(); ++r) {
    const std::string stem = fmt::format("run_{:03}", r);
    std::string places = kPlacesHeader;
    for (std::size_t g = 0; g < world.groups.size(); ++g) {
      const ModeNumber mode = world.runs[r].active_mode[g];
      modes +=
          fmt::format("{},{},{}\n", stem, CsvText(world.groups[g].signature.text()), mode.value());
      if (mode != kAbsent) places += PlaceRow(world.groups[g], mode);
    }
    SHIFTMAP_RETURN_IF_ERROR(
        WriteFileAtomically(fmt::format("{}/{}.places.csv", directory, stem), places));
    paths.push_back(fmt::format("{}/{}.mcap", directory, stem));
    SHIFTMAP_RETURN_IF_ERROR(WriteRunLog(world.runs[r].run, paths.back()));
    SHIFTMAP_RETURN_IF_ERROR(
        WriteTum(world.runs[r].truth, fmt::format("{}/{}.truth.tum", directory, stem)));
  }
  SHIFTMAP_RETURN_IF_ERROR(WriteFileAtomically(directory + "/modes.csv", modes));
  return paths;
}

}  // namespace shiftmap
