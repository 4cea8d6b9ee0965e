// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/resume_mark.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <utility>

#include "mapstore/core/atomic_file.h"

namespace shiftmap::live {

ResumeMark::ResumeMark(std::string path) : path_(std::move(path)) {
  std::ifstream file(path_);
  std::uint64_t record = 0;
  int failures = 0;
  if (!(file >> record >> failures)) return;
  record_ = record;
  failures_ = std::max(failures, 0);
}

Status ResumeMark::Reach(std::uint64_t record) const {
  const int failures = failures_ > 0 && record == record_ ? failures_ + 1 : 1;
  return WriteFileAtomically(path_, fmt::format("{} {}\n", record, failures));
}

void ResumeMark::Clear() const { unlink(path_.c_str()); }

}  // namespace shiftmap::live
