// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "tests/fault/file_observer.h"

namespace shiftmap::testing {

/// Which requests fail, and how.
enum class Fault {
  kAnyOnce,       ///< One request of any kind, with the I/O error of its kind.
  kAnyFromThen,   ///< That one and all after it: the device is gone.
  kDiskFull,      ///< One write: half of its bytes land, then no space is left.
  kStaysFull,     ///< That write and all after it.
  kReadOnlyDisk,  ///< From one modifying request on, all of them: the disk was remounted.
};

const char* NameOf(Fault fault);

/// Lets the n-th request that a fault can hit fail.
class FaultPlan : public FileObserver {
 public:
  /// @param at  From 1.
  FaultPlan(Fault fault, int at) : fault_(fault), at_(at) {}

  Verdict On(const FileEvent& event) override;

  /// From now on nothing fails.
  void Stop() { stopped_ = true; }

  /// True once a request has failed.
  bool fired() const { return seen_ >= at_; }

 private:
  Fault fault_;
  int at_;
  int seen_ = 0;
  bool stopped_ = false;
};

}  // namespace shiftmap::testing
