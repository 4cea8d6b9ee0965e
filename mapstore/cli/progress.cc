// SPDX-License-Identifier: Apache-2.0
#include "mapstore/cli/progress.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>

#include "mapstore/core/inert_text.h"

namespace shiftmap {
namespace {

constexpr int kBarWidth = 30;
constexpr const char* kClearLine = "\r\033[K";

}  // namespace

Progress::~Progress() {
  if (stream_ != nullptr && !shown_.empty()) *stream_ << kClearLine << std::flush;
}

void Progress::Update(const std::string& phase, double done) {
  if (stream_ == nullptr) return;
  const double share = std::clamp(done, 0.0, 1.0);
  const int filled = static_cast<int>(std::lround(share * kBarWidth));
  std::string line = fmt::format("[{:<{}}] {:3.0f} % {}",
                                 std::string(static_cast<std::size_t>(filled), '#'),
                                 kBarWidth,
                                 100.0 * share,
                                 InertLine(phase));
  // A terminal is slower than most loops: write only what changes.
  if (line == shown_) return;
  *stream_ << kClearLine << line << std::flush;
  shown_ = std::move(line);
}

bool StandardErrorIsTerminal() { return ::isatty(STDERR_FILENO) == 1; }

}  // namespace shiftmap
