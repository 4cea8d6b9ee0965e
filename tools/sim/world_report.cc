// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/world_report.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

namespace shiftmap {

void ReportWorld(const SimulatedWorld& world,
                 const std::string& directory,
                 const std::vector<std::string>& paths,
                 Context* context) {
  Json runs = Json::array();
  std::size_t observations = 0;
  for (std::size_t r = 0; r < world.runs.size(); ++r) {
    const Run& run = world.runs[r].run;
    std::size_t count = 0;
    for (const Scan& scan : run.scans) count += scan.observations.size();
    observations += count;
    runs.push_back({{"path", paths.empty() ? "" : paths[r]},
                    {"odometry", run.odometry.size()},
                    {"scans", run.scans.size()},
                    {"observations", count}});
  }
  context->Report({{"output", directory}, {"groups", world.groups.size()}, {"runs", runs}},
                  fmt::format("{} runs with {} observations of {} landmarks in {}\n",
                              world.runs.size(),
                              observations,
                              world.groups.size(),
                              directory));
}

}  // namespace shiftmap
