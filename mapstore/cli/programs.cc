// SPDX-License-Identifier: Apache-2.0
#include "mapstore/cli/programs.h"

#include <algorithm>
#include <cctype>

namespace shiftmap {

const std::vector<ProgramCommands>& AllPrograms() {
  static const auto* const kPrograms = new std::vector<ProgramCommands>{
      {"mapper", {"build", "import", "nightly"}},
      {"localizer", {"ctl", "fetch", "return", "run", "serve", "sync", "upload"}},
      {"server", {}},
      {"inspect",
       {"areas",   "audit",   "backup",    "compact",  "config",  "diff",     "edit",    "export",
        "history", "migrate", "modes",     "plot",     "publish", "reports",  "restore", "rollback",
        "runs",    "show",    "sightings", "vehicles", "verify",  "versions", "view"}},
      {"sim", {"mine", "open"}},
      {"convert", {"carmen", "check", "csv", "lidar-json", "rosbag2", "utias", "victoria-park"}},
      {"eval", {"map", "trajectory"}},
      {"experiment",
       {"alignments",
        "engines",
        "fleet-nights",
        "groupings",
        "ijrr-selectors",
        "ijrr-utias",
        "layout-pairs",
        "ledger-years",
        "lidar-repeatability",
        "lidar-run",
        "localizer-bodies",
        "localizer-consistency",
        "localizer-decisions",
        "localizer-recorded",
        "localizer-states",
        "localizer-utias",
        "map-consistency",
        "nights",
        "papers",
        "recurring-chains",
        "scale",
        "tiv-approximations",
        "tiv-mine",
        "tiv-posterior",
        "tiv-removal",
        "vehicle-faults",
        "victoria-park"}},
  };
  return *kPrograms;
}

const std::vector<std::string>& SharedKeys() {
  static const auto* const kKeys = new std::vector<std::string>{"area",
                                                                "ca",
                                                                "client-ca",
                                                                "clock-tolerance-s",
                                                                "log-level",
                                                                "map-source",
                                                                "maps",
                                                                "quiet",
                                                                "server",
                                                                "store",
                                                                "tls-ca",
                                                                "tls-cert",
                                                                "tls-key"};
  return *kKeys;
}

bool IsOfOwnTable(const std::string& command, const std::string& key) {
  return command == "nightly" && key == "area";
}

std::string EnvironmentNameOf(const std::string& key) {
  const std::vector<std::string>& keys = SharedKeys();
  if (std::find(keys.begin(), keys.end(), key) == keys.end()) return "";
  std::string name = "SHIFTMAP_" + key;
  for (char& c : name) {
    c = c == '-' ? '_' : static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  }
  return name;
}

}  // namespace shiftmap
