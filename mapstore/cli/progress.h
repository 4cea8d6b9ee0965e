// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <ostream>
#include <string>

namespace shiftmap {

/// One line on a terminal that says how far a command is; it rewrites itself and is gone in the
/// end.
class Progress {
 public:
  /// @param stream  Nothing is written if null. Must outlive this.
  explicit Progress(std::ostream* stream) : stream_(stream) {}
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// @param done  Share of the phase that is done, in [0, 1].
  void Update(const std::string& phase, double done);

 private:
  std::ostream* stream_;
  std::string shown_;
};

/// True if standard error is a terminal.
bool StandardErrorIsTerminal();

}  // namespace shiftmap
