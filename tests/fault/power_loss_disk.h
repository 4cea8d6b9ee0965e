// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "tests/fault/file_observer.h"

namespace shiftmap::testing {

/// A change of the file system, as the code under test asked for it.
struct DiskChange {
  FileOperation operation;
  std::string path;
  std::string target;
  std::int64_t offset = 0;
  std::string bytes;
};

/// Records all changes of files under one folder.
class DiskRecorder : public FileObserver {
 public:
  explicit DiskRecorder(std::string folder) : folder_(std::move(folder)) {}

  Verdict On(const FileEvent& event) override;

  const std::vector<DiskChange>& changes() const { return changes_; }

 private:
  std::string folder_;
  std::vector<DiskChange> changes_;
};

/// What is left of changes that were not synced when the power went.
enum class Leftover {
  kNone,  ///< Only what was synced.
  kAll,   ///< Everything, as after SIGKILL.
  kSome,  ///< Any of the changes, later ones without earlier ones, writes torn at 512 bytes.
};

/// A disk with a write cache: what is on it for sure, and what may or may not be.
///
/// Contents are sure once their file is synced, names once their folder is: as POSIX promises, and
/// no more (ext4 syncs the name of a file that it syncs; others do not).
class PowerLossDisk {
 public:
  void Apply(const DiskChange& change);

  /// Writes the files that are there after the power comes back, into a folder.
  void WriteImage(Leftover leftover, std::mt19937_64& random, const std::string& folder) const;

 private:
  using FileNumber = std::size_t;

  // A write or truncation of one file that is not synced.
  struct FileChange {
    bool truncates = false;
    std::size_t offset = 0;  // A truncation's size.
    std::string bytes;
  };
  struct File {
    std::string synced;
    std::vector<FileChange> pending;
  };

  // The name `path` now stands for a file, or for none; `source` no longer stands for it.
  struct NameChange {
    std::string path;
    std::optional<FileNumber> file;
    std::string source;
  };
  using Names = std::map<std::string, FileNumber>;

  static void Rename(const NameChange& change, Names* names);
  static std::string ContentOf(const File& file, Leftover leftover, std::mt19937_64& random);
  Names NamesLeft(Leftover leftover, std::mt19937_64& random) const;
  void Change(NameChange change);

  std::vector<File> files_;
  Names names_;         // As the running program sees them.
  Names synced_names_;  // For sure.
  std::vector<NameChange> pending_names_;
};

}  // namespace shiftmap::testing
