// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <future>
#include <string>
#include <string_view>

#include "proto/core/status.h"

namespace shiftmap::live {

/// An append-only file of checksummed records that survives a crash at any byte.
///
///   magic    8 bytes  "SHMJRNL1"
///   record   length (4), CRC-32 of the length's bytes and the content (4), content; both numbers
///            little-endian
///
/// Append() only remembers; Write() hands what was remembered to the operating system, where it
/// survives the end of this process; Sync() makes it survive a power failure. StartSync() leaves
/// the waiting for the disk to a thread of its own.
///
/// While the disk takes no records, up to kMaxUnwrittenBytes of them stay in memory. The journal
/// drops all later records, so that it always holds the begin of a shift without gaps.
///
/// Errors: kUnavailable if the disk does not take it. Messages start with `journal 'PATH': `.
class JournalFile {
 public:
  /// Makes an empty journal, durable under its name. Errors also: kAlreadyExists.
  static StatusOr<JournalFile> Create(const std::string& path);

  /// Takes a journal up again behind its first `bytes` bytes; the rest is cut off.
  static StatusOr<JournalFile> Resume(const std::string& path, std::uint64_t bytes);

  JournalFile(JournalFile&& other) noexcept;
  JournalFile& operator=(JournalFile&& other) noexcept;
  ~JournalFile();

  /// Precondition: at most kMaxRecordBytes.
  void Append(std::string_view record);

  /// Errors also: that records are missing, each time from then on.
  Status Write();
  Status Sync();

  /// Writes, and has a thread make durable what was written; while one still waits for the disk, no
  /// other is started. Returns without waiting.
  /// Errors also: what the thread before this one ended with, once.
  Status StartSync();

  static constexpr std::size_t kMaxRecordBytes = std::size_t{4} << 20;
  static constexpr std::size_t kMaxUnwrittenBytes = std::size_t{64} << 20;

 private:
  JournalFile(std::string path, int fd) : path_(std::move(path)), fd_(fd) {}

  Status Flush();
  Status Whole() const;  // kUnavailable if records are missing.

  std::string path_;
  int fd_ = -1;
  std::string unwritten_;
  bool ended_ = false;           // There was more than can be remembered.
  std::future<Status> syncing_;  // Invalid: nothing under way.
};

/// What was found in a journal.
struct JournalEnd {
  std::uint64_t records = 0;
  std::uint64_t whole_bytes = 0;  ///< The records and the magic: where to resume.
  std::uint64_t cut_bytes = 0;    ///< Behind them: a record that was being written, or damage.
};

/// Reads the records front to back, up to the first that is not whole or has a wrong checksum.
/// @param take  Called for each; its error ends the reading and is returned.
/// Errors: kNotFound; kDataLoss if not even the magic is whole; kUnavailable if it cannot be read.
StatusOr<JournalEnd> ReadJournal(const std::string& path,
                                 const std::function<Status(std::string_view)>& take);

}  // namespace shiftmap::live
