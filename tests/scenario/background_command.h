// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

#include "tests/scenario/command.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {

/// One of the project's programs, running beside the test; killed with this object.
class BackgroundCommand {
 public:
  /// @param input  Path of what it reads on standard input; empty: that of the test.
  BackgroundCommand(const std::string& program,
                    const Arguments& arguments,
                    const std::vector<std::string>& environment = {},
                    const std::string& input = {});
  ~BackgroundCommand();
  BackgroundCommand(const BackgroundCommand&) = delete;
  BackgroundCommand& operator=(const BackgroundCommand&) = delete;

  /// Sends a signal (none: 0) and waits for the end; the exit code as in CommandResult.
  int End(int signal);

  pid_t pid() const { return child_; }

  /// Waits until it takes a signal itself instead of being ended by it.
  void WaitUntilItCatches(int signal) const;

  /// The most memory that it had, once it has ended.
  double PeakMib() const { return peak_mib_; }

  /// What it printed so far.
  std::string Output() const { return ReadFile(folder_.File("out")); }

  /// What it said on standard error so far.
  std::string Errors() const { return ReadFile(folder_.File("err")); }

 private:
  TempDir folder_;
  pid_t child_ = -1;
  double peak_mib_ = 0.0;
};

}  // namespace shiftmap::testing
