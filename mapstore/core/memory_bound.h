// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

namespace shiftmap {

/// Where the kernel says what a process may take.
struct MemoryBoundSources {
  std::string process_cgroup = "/proc/self/cgroup";
  std::string cgroup_root = "/sys/fs/cgroup";
};

/// Memory that this process can take at most: the least of the machine's memory, the limits of its
/// control groups (v2 memory.max, v1 memory.limit_in_bytes) and RLIMIT_AS and RLIMIT_DATA. [bytes]
std::int64_t MemoryBound(const MemoryBoundSources& sources = {});

}  // namespace shiftmap
