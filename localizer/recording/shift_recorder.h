// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "localizer/localizer.h"
#include "localizer/recording/shift_recording.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Records a shift (shift_recording.h) from outside of the localizer's step: it looks at the
/// localizer between two items, and writes.
///
/// The file grows with the scans of the log, not with the size of the map. It appears at its path
/// whole or not at all, and takes the place of another recording, but of no run log.
/// Errors: as AtomicFile; messages start with `recording 'PATH': `.
class ShiftRecorder {
 public:
  /// Writes what comes once.
  /// @param shift  Vehicle, run and software; the rest is taken from the map.
  /// @param map    Of the localizer.
  /// @param begin  Of the first item.
  /// Errors also: kInvalidArgument for a name that is not UTF-8.
  static StatusOr<ShiftRecorder> Create(const std::string& path,
                                        RecordedShift shift,
                                        const MapSnapshot& map,
                                        Stamp begin);

  ShiftRecorder(ShiftRecorder&&) noexcept;
  ShiftRecorder& operator=(ShiftRecorder&&) noexcept;
  ~ShiftRecorder();

  /// Writes what the last Process() or Flush() of the localizer changed. To be called after each.
  Status Record(const Localizer& localizer);

  /// Places the file. Call once, last.
  Status Finish();

 private:
  struct State;
  explicit ShiftRecorder(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace shiftmap
