// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

namespace shiftmap::testing {

/// A running busy_writer.
class WriterProcess {
 public:
  /// Aborts if the program cannot be started.
  WriterProcess(const std::string& store, int writer, int pause_ms);
  ~WriterProcess();
  WriterProcess(const WriterProcess&) = delete;
  WriterProcess& operator=(const WriterProcess&) = delete;

  /// Ends it by SIGKILL; appends the lines that it acknowledged. False if it had ended by itself.
  bool Kill(std::vector<std::string>* lines);

 private:
  pid_t pid_ = -1;
  int pipe_ = -1;
};

}  // namespace shiftmap::testing
