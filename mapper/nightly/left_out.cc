// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/left_out.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cstdint>
#include <filesystem>
#include <sstream>
#include <system_error>

#include "mapper/nightly/candidate.h"
#include "mapstore/core/memory_bound.h"
#include "mapstore/map/sha256.h"

namespace shiftmap {
namespace {

// Of all that a build of the logs depends on.
StatusOr<std::string> KeyOf(const NightOptions& options,
                            const std::string& area,
                            const std::vector<LogHead>& logs,
                            MapStore* store) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<AuditEntry> decisions,
                            store->AuditLog(area,
                                            {AuditAction::kPublish,
                                             AuditAction::kRollback,
                                             AuditAction::kExclude,
                                             AuditAction::kHold,
                                             AuditAction::kInclude,
                                             AuditAction::kEdit,
                                             AuditAction::kUndo}));
  std::uintmax_t bytes = 0;
  for (const LogHead& log : logs) {
    std::error_code error;
    const std::uintmax_t size = std::filesystem::file_size(log.path, error);
    if (!error) bytes += size;
  }
  constexpr std::int64_t kMib = std::int64_t{1024} * 1024;
  const AreaBuildOptions& build = options.build;
  Sha256 hash;
  hash.Update(fmt::format("{} {} {} {}",
                          NightKey(logs, build),
                          decisions.size(),
                          bytes,
                          build.max_memory_mib.value_or(MemoryBound() / kMib)));
  return hash.HexDigest();
}

}  // namespace

StatusOr<std::set<std::string>> ReadLeftOut(const NightOptions& options,
                                            const std::string& area,
                                            const std::vector<LogHead>& logs,
                                            MapStore* store) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string key, KeyOf(options, area, logs, store));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<AuditEntry> notes,
                            store->AuditLog(area, {AuditAction::kLeave}));
  std::set<std::string> left_out;
  if (notes.empty()) return left_out;
  std::istringstream words(notes.back().subject);
  std::string word;
  if (!(words >> word) || word != key) return left_out;
  while (words >> word) left_out.insert(word);
  return left_out;
}

Status NoteLeftOut(const NightOptions& options,
                   const std::string& area,
                   const std::vector<LogHead>& logs,
                   const std::set<std::string>& left_out,
                   MapStore* store) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string key, KeyOf(options, area, logs, store));
  return store->AddNote(
      area, NightNote::kLeftOut, fmt::format("{} {}", key, fmt::join(left_out, " ")));
}

}  // namespace shiftmap
