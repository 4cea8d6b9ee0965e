// SPDX-License-Identifier: Apache-2.0
#include "tools/inspect/trajectory_export.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <set>
#include <string_view>

namespace shiftmap {
namespace {

constexpr std::size_t kMaxNameBytes = 200;

// A name that no shell, path or terminal takes for something else.
std::string FileName(std::string_view name) {
  const auto is_plain = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' ||
           c == '_' || c == '-';
  };
  std::string plain(name.substr(0, kMaxNameBytes));
  std::replace_if(
      plain.begin(), plain.end(), [&](char c) { return !is_plain(c); }, '_');
  const bool hidden_or_option = plain.empty() || plain.front() == '.' || plain.front() == '-';
  return fmt::format("{}{}", hidden_or_option ? "_" : "", plain);
}

}  // namespace

std::vector<TrajectoryFile> TrajectoryFiles(const std::vector<RunRecord>& runs,
                                            const std::string& folder) {
  std::vector<TrajectoryFile> files;
  std::set<std::string> taken;
  for (const RunRecord& run : runs) {
    if (run.trajectory.empty()) continue;
    const std::string name = FileName(run.name);
    std::string unique = name;
    for (int i = 2; !taken.insert(unique).second; ++i) unique = fmt::format("{}-{}", name, i);
    files.push_back({&run, fmt::format("{}/{}.tum", folder, unique)});
  }
  return files;
}

StatusOr<const RunRecord*> FindRun(const std::vector<RunRecord>& runs, const std::string& text) {
  const RunRecord* found = nullptr;
  std::vector<std::string> names;
  for (const RunRecord& run : runs) {
    names.push_back(run.name);
    if (run.name != text && (text.empty() || !run.identity().starts_with(text))) continue;
    if (found != nullptr) {
      return InvalidArgument("run '{}': may be '{}' or '{}', give the first digits of its identity",
                             text,
                             found->identity(),
                             run.identity());
    }
    found = &run;
  }
  if (found != nullptr) return found;
  return NotFound("run '{}': the version is built from '{}'", text, fmt::join(names, "', '"));
}

}  // namespace shiftmap
