// SPDX-License-Identifier: Apache-2.0
#include "mapstore/sqlite/temporary_database.h"

#include <filesystem>
#include <utility>

namespace shiftmap {

StatusOr<TemporaryDatabase> TemporaryDatabase::Create(const std::string& destination) {
  StatusOr<AtomicFile> claim = AtomicFile::Create(destination, FileKind::kDatabase);
  SHIFTMAP_RETURN_IF_ERROR(Annotate(claim.status(), "file '{}'", destination));
  TemporaryDatabase database(*std::move(claim));
  database.Remove();
  return database;
}

TemporaryDatabase::TemporaryDatabase(AtomicFile claim)
    : claim_(std::move(claim)), path_(claim_.temporary() + "-db") {}

TemporaryDatabase::~TemporaryDatabase() {
  if (claim_.open()) Remove();
}

void TemporaryDatabase::Remove() const {
  std::error_code error;
  std::filesystem::remove(path_, error);
  std::filesystem::remove(path_ + "-journal", error);
}

}  // namespace shiftmap
