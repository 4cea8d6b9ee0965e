// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "mapstore/core/folder.h"
#include "proto/core/status.h"

namespace shiftmap::rosbag2 {

/// One file of a bag.
struct BagFile {
  enum class Storage { kMcap, kSqlite };

  std::string path;
  Storage storage = Storage::kMcap;
  bool zstd = false;  ///< Compressed as a whole.
};

/// The files of a bag: of a folder those that its metadata.yaml lists, or all of it in the order of
/// their numbers where the recorder was killed before it wrote one; or a single file.
/// Errors: kNotFound if there is none; kInvalidArgument for files of another kind, or metadata that
/// is not a bag's. Messages start with `bag 'PATH': `.
StatusOr<std::vector<BagFile>> FindBagFiles(const std::string& path);

/// A copy of a file in a folder of its own, both removed at the end.
class ScratchCopy {
 public:
  /// Undoes the compression of a whole file. The copy takes at most 64 MiB and 100 bytes per byte
  /// of the file. Errors: kDataLoss if it is not zstd's or expands to more; kUnavailable if there
  /// is no room in the folder for temporary files.
  static StatusOr<ScratchCopy> Decompress(const std::string& path);

  /// Copies a database together with the log that its writer left beside it.
  /// Errors: kUnavailable, as above.
  static StatusOr<ScratchCopy> WithWriteAheadLog(const std::string& path);

  const std::string& path() const { return path_; }

 private:
  static StatusOr<ScratchCopy> Create(const std::string& path);
  ScratchCopy(ScratchFolder folder, std::string path)
      : folder_(std::move(folder)), path_(std::move(path)) {}

  ScratchFolder folder_;
  std::string path_;
};

/// Whether a database has a log of writes beside it that are not in it yet.
bool HasWriteAheadLog(const std::string& path);

/// The bytes of a message whose recorder compressed each one by itself, or the bytes themselves.
/// @param buffer  Holds what was decompressed, at most 64 MiB.
/// Errors: kDataLoss.
StatusOr<std::string_view> PlainMessage(std::string_view data, std::string* buffer);

}  // namespace shiftmap::rosbag2
