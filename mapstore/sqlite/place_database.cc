// SPDX-License-Identifier: Apache-2.0
#include "mapstore/sqlite/place_database.h"

#include <filesystem>

#include "mapstore/core/atomic_file.h"
#include "mapstore/sqlite/database.h"

namespace shiftmap {

Status PlaceDatabase(const std::string& temporary, const std::string& destination) {
  std::error_code error;
  const std::string journal = destination + "-journal";
  if (std::filesystem::exists(journal, error)) {
    if (std::filesystem::exists(destination, error)) {
      Database::Options options;
      options.mode = Database::Mode::kReadWrite;
      SHIFTMAP_RETURN_IF_ERROR(Database::Open(destination, options).status());
    }
    std::filesystem::remove(journal, error);
    if (error) return Unavailable("file '{}': {}", journal, error.message());
  }
  return SyncAndRename(temporary, destination);
}

}  // namespace shiftmap
