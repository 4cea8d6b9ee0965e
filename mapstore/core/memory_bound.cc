// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/memory_bound.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <string>
#include <string_view>

namespace shiftmap {
namespace {

constexpr std::int64_t kNoLimit = std::numeric_limits<std::int64_t>::max();

std::int64_t ResourceLimit(__rlimit_resource resource) {
  rlimit limit{};
  if (getrlimit(resource, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY) return kNoLimit;
  return static_cast<std::int64_t>(std::min<rlim_t>(limit.rlim_cur, kNoLimit));
}

// A file that is absent or holds no number, as `max`, states no limit.
std::int64_t LimitIn(const std::string& path) {
  std::ifstream file(path);
  std::int64_t limit = 0;
  return file >> limit ? limit : kNoLimit;
}

// The least limit of a group and of those that it is in. Inside a container the path may be that of
// the host, of which only the root is visible.
std::int64_t GroupLimit(const std::string& root, std::string group, const std::string& name) {
  std::int64_t least = kNoLimit;
  for (;;) {
    while (group.ends_with('/')) group.pop_back();
    least = std::min(least, LimitIn(root + group + "/" + name));
    if (group.empty()) return least;
    const std::size_t slash = group.rfind('/');
    group.erase(slash == std::string::npos ? 0 : slash);
  }
}

bool HasMemoryController(std::string_view controllers) {
  while (!controllers.empty()) {
    const std::size_t comma = controllers.find(',');
    if (controllers.substr(0, comma) == "memory") return true;
    controllers.remove_prefix(comma == std::string_view::npos ? controllers.size() : comma + 1);
  }
  return false;
}

// Lines are `0::PATH` for version 2 and `NUMBER:CONTROLLERS:PATH` for version 1.
std::int64_t ControlGroupLimit(const MemoryBoundSources& sources) {
  std::int64_t least = kNoLimit;
  std::ifstream file(sources.process_cgroup);
  for (std::string line; std::getline(file, line);) {
    const std::size_t first = line.find(':');
    const std::size_t second = line.find(':', first + 1);
    if (first == std::string::npos || second == std::string::npos) continue;
    const std::string controllers = line.substr(first + 1, second - first - 1);
    const std::string group = line.substr(second + 1);
    if (controllers.empty()) {
      least = std::min(least, GroupLimit(sources.cgroup_root, group, "memory.max"));
    } else if (HasMemoryController(controllers)) {
      least = std::min(least,
                       GroupLimit(sources.cgroup_root + "/memory", group, "memory.limit_in_bytes"));
    }
  }
  return least;
}

}  // namespace

std::int64_t MemoryBound(const MemoryBoundSources& sources) {
  const std::int64_t physical = std::int64_t{sysconf(_SC_PHYS_PAGES)} * sysconf(_SC_PAGESIZE);
  return std::min(
      {physical, ControlGroupLimit(sources), ResourceLimit(RLIMIT_AS), ResourceLimit(RLIMIT_DATA)});
}

}  // namespace shiftmap
