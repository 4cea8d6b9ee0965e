// SPDX-License-Identifier: Apache-2.0
#include "tests/fault/fault_plan.h"

#include <sqlite3.h>

namespace shiftmap::testing {
namespace {

int IoErrorOf(FileOperation operation) {
  switch (operation) {
    case FileOperation::kOpen:
      return SQLITE_CANTOPEN;
    case FileOperation::kRead:
      return SQLITE_IOERR_READ;
    case FileOperation::kWrite:
      return SQLITE_IOERR_WRITE;
    case FileOperation::kTruncate:
      return SQLITE_IOERR_TRUNCATE;
    case FileOperation::kSync:
      return SQLITE_IOERR_FSYNC;
    case FileOperation::kSyncFolder:
      return SQLITE_IOERR_DIR_FSYNC;
    case FileOperation::kDelete:
      return SQLITE_IOERR_DELETE;
    case FileOperation::kRename:
      return SQLITE_IOERR;
    case FileOperation::kAccess:
      return SQLITE_IOERR_ACCESS;
    case FileOperation::kLock:
      return SQLITE_IOERR_LOCK;
  }
  return SQLITE_IOERR;
}

bool Modifies(const FileEvent& event) {
  switch (event.operation) {
    case FileOperation::kOpen:
      return event.creates;
    case FileOperation::kWrite:
    case FileOperation::kTruncate:
    case FileOperation::kDelete:
    case FileOperation::kRename:
      return true;
    default:
      return false;
  }
}

bool CanHit(Fault fault, const FileEvent& event) {
  switch (fault) {
    case Fault::kAnyOnce:
    case Fault::kAnyFromThen:
      return true;
    case Fault::kDiskFull:
    case Fault::kStaysFull:
      return event.operation == FileOperation::kWrite;
    case Fault::kReadOnlyDisk:
      return Modifies(event);
  }
  return false;
}

}  // namespace

const char* NameOf(Fault fault) {
  switch (fault) {
    case Fault::kAnyOnce:
      return "AnyOnce";
    case Fault::kAnyFromThen:
      return "AnyFromThen";
    case Fault::kDiskFull:
      return "DiskFull";
    case Fault::kStaysFull:
      return "StaysFull";
    case Fault::kReadOnlyDisk:
      return "ReadOnlyDisk";
  }
  return "";
}

Verdict FaultPlan::On(const FileEvent& event) {
  if (stopped_ || !CanHit(fault_, event)) return {};
  ++seen_;
  const bool once = fault_ == Fault::kAnyOnce || fault_ == Fault::kDiskFull;
  if (seen_ < at_ || (once && seen_ > at_)) return {};
  const bool full = fault_ == Fault::kDiskFull || fault_ == Fault::kStaysFull;
  return full ? Verdict{.code = SQLITE_FULL, .half_done = true}
              : Verdict{.code = IoErrorOf(event.operation)};
}

}  // namespace shiftmap::testing
