// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "mapstore/run/run.h"
#include "proto/core/status.h"

namespace shiftmap {

/// A run as read from a file, with what a reader must know about the file.
struct RunLog {
  Run run;
  std::string sha256;  ///< Of the file's bytes, in hex.
  /// Non-empty if the file ends early, e.g. by a power failure: says where. `run` holds everything
  /// up to the last whole chunk.
  std::string truncation;
};

struct RunLogReaderOptions {
  /// What the run may take while it is read. Vectors that grow are there twice. By default a
  /// quarter of MemoryBound(), as a caller copies the run. [bytes]
  std::optional<std::int64_t> max_memory_bytes = std::nullopt;

  /// Off skips a lidar's scans as it does other topics: they take most of the memory of a log that
  /// has them, and graphs need none.
  bool lidar_scans = true;
};

/// Reads a run log (MCAP with shiftmap messages; see proto/FORMATS.md) whole and checks it with
/// ValidateRun. Messages on other topics are skipped.
/// Errors: kNotFound; kInvalidArgument if it is not an MCAP file, has no odometry, goes backwards
/// in time, or takes more memory than the options allow; kDataLoss if a checksum is wrong. Every
/// message starts with `run log 'PATH': `.
StatusOr<RunLog> ReadRunLog(const std::string& path, const RunLogReaderOptions& options = {});

struct RunLogWriterOptions {
  bool compress = true;  ///< zstd chunks; off makes larger files that any tool can read.
  /// Uncompressed size at which a chunk is closed, if it does not hold a second of the run before.
  std::int64_t chunk_bytes = 256 << 10;
};

/// Writes a run log: to a temporary file beside `path`, fsync, rename. The same run gives the same
/// bytes. Errors: kInvalidArgument if ValidateRun fails; kUnavailable if the disk does not take it.
Status WriteRunLog(const Run& run,
                   const std::string& path,
                   const RunLogWriterOptions& options = {});

/// Writes a run log item by item, in constant memory. The same items give the same bytes as
/// WriteRunLog. What is not finished leaves nothing behind.
/// Errors: as WriteRunLog.
class RunLogWriter {
 public:
  static StatusOr<RunLogWriter> Create(const std::string& path,
                                       const RunInfo& info,
                                       const RunLogWriterOptions& options = {});

  RunLogWriter(RunLogWriter&&) noexcept;
  RunLogWriter& operator=(RunLogWriter&&) noexcept;
  ~RunLogWriter();

  /// Appends an item. Errors also: kInvalidArgument if it is older than the one before.
  Status Write(const RunEvent& event);

  /// Whether there was odometry, without which the items are no run log.
  bool has_odometry() const;

  /// Places the file. Errors also: kInvalidArgument if there was no odometry. Call once, last.
  Status Finish();

 private:
  struct State;
  explicit RunLogWriter(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// Reads a run log item by item, from a file or a pipe, in constant memory, in the order of the
/// file: that of one chunk, of 64 MiB at most. Items are checked by ValidateEvent; order is the
/// consumer's business.
class RunLogStream {
 public:
  /// @param path         A file, or "-" for standard input.
  /// @param lidar_scans  As RunLogReaderOptions::lidar_scans.
  static StatusOr<RunLogStream> Open(const std::string& path, bool lidar_scans = true);

  RunLogStream(RunLogStream&&) noexcept;
  RunLogStream& operator=(RunLogStream&&) noexcept;
  ~RunLogStream();

  /// The next item, or nothing at the end of the stream.
  StatusOr<std::optional<RunEvent>> Next();

  /// Complete only after the first item was read.
  const RunInfo& info() const;

  /// As RunLog::truncation; complete after Next() returned nothing.
  const std::string& truncation() const;

 private:
  struct State;
  explicit RunLogStream(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace shiftmap
