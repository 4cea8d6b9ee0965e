// SPDX-License-Identifier: Apache-2.0
//
// Builds a map of a run that the input has edited and one that is sound. A map that is made is
// valid, with finite poses.
#include "mapper/mapper.h"
#include "proto/core/check.h"
#include "tests/fuzz/fuzz_run.h"
#include "tests/fuzz/fuzz_target.h"

namespace shiftmap::testing {
namespace {

MapperInput InputOf(const std::string& name, const std::vector<RunEvent>& events) {
  MapperInput input{name, name, {}};
  input.run.info.vehicle = "truck";
  for (const RunEvent& event : events) {
    if (const auto* sample = std::get_if<OdometrySample>(&event)) {
      input.run.odometry.push_back(*sample);
    } else if (const auto* scan = std::get_if<Scan>(&event)) {
      input.run.scans.push_back(*scan);
    }
  }
  return input;
}

}  // namespace

std::vector<std::string> FuzzSeeds() { return EditSeeds(); }

void RunFuzzInput(std::string_view bytes) {
  static const FuzzWorld world;
  FuzzInput input(bytes);
  std::vector<RunEvent> events = world.events;
  EditEvents(&input, &events);
  const MapperInput edited = InputOf("edited", events);
  // A log that is not valid is not read.
  if (!ValidateRun(edited.run).ok()) return;
  MapperOptions options;
  options.threads = 1;
  const auto result = BuildMap({edited, InputOf("sound", world.events)}, {}, options);
  if (!result.ok()) return;
  const Status valid = ValidateMapContent(result->content);
  SHIFTMAP_CHECK(valid.ok(), "an invalid map was built: {}", Message(valid));
  for (const MappedRun& run : result->runs) {
    for (const StampedPose& pose : run.trajectory) {
      SHIFTMAP_CHECK(pose.T_map_vehicle.translation().allFinite(), "a pose is not finite");
    }
  }
}

}  // namespace shiftmap::testing
