// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "proto/core/status.h"

namespace shiftmap::live {

/// A durable note of the place that the replay of a journal has reached. A process that dies there
/// leaves the note behind, and the next one reads how often that happened.
///
/// Only attempts that ended at one place count. A vehicle that is switched off during a long replay
/// ends it at another place each time.
class ResumeMark {
 public:
  /// Reads the note that earlier attempts left at `path`; without one there were none.
  explicit ResumeMark(std::string path);

  /// Successive attempts that ended at one place.
  int failures() const { return failures_; }

  /// Notes that this attempt goes on from a record, counted from 0.
  /// Errors: as WriteFileAtomically.
  Status Reach(std::uint64_t record) const;

  /// Removes the note: the attempt succeeded, or the journal is gone.
  void Clear() const;

 private:
  std::string path_;
  std::uint64_t record_ = 0;  // Where the last attempt ended.
  int failures_ = 0;
};

}  // namespace shiftmap::live
