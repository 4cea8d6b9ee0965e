// SPDX-License-Identifier: Apache-2.0
#include "mapstore/cli/internal/watch.h"

#include <fmt/format.h>
#include <signal.h>
#include <time.h>

#include <algorithm>
#include <cmath>
#include <sstream>
#include <string>

#include "mapstore/core/clock.h"

namespace shiftmap {
namespace {

volatile sig_atomic_t stopped = 0;

void Stop(int /*signal*/) { stopped = 1; }

// Takes the signals that end a watch while it lives.
class ScopedSignals {
 public:
  ScopedSignals() {
    stopped = 0;
    struct sigaction action = {};
    action.sa_handler = Stop;
    sigaction(SIGINT, &action, &interrupt_);
    sigaction(SIGTERM, &action, &terminate_);
  }
  ~ScopedSignals() {
    sigaction(SIGINT, &interrupt_, nullptr);
    sigaction(SIGTERM, &terminate_, nullptr);
  }
  ScopedSignals(const ScopedSignals&) = delete;
  ScopedSignals& operator=(const ScopedSignals&) = delete;

 private:
  struct sigaction interrupt_ = {};
  struct sigaction terminate_ = {};
};

timespec After(timespec time, double seconds) {
  const double whole = std::floor(seconds);
  time.tv_sec += static_cast<time_t>(whole);
  time.tv_nsec += static_cast<long>((seconds - whole) * 1e9);
  if (time.tv_nsec >= 1'000'000'000) {
    time.tv_nsec -= 1'000'000'000;
    ++time.tv_sec;
  }
  return time;
}

// Until the time, or a signal.
void SleepUntil(const timespec& time) {
  while (stopped == 0 && clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &time, nullptr) == EINTR) {
  }
}

// The first lines of a text; the last one says how many are left out.
std::string FirstLines(const std::string& text, int lines) {
  const auto all = static_cast<int>(std::count(text.begin(), text.end(), '\n'));
  if (all <= lines) return text;
  std::size_t end = 0;
  for (int i = 0; i + 1 < lines; ++i) end = text.find('\n', end) + 1;
  return text.substr(0, end) + fmt::format("… {} more lines", all - lines + 1);
}

}  // namespace

ExitCode Watch(double period_s,
               const TextStyle& style,
               std::ostream* out,
               const std::function<ExitCode(std::ostream*)>& once) {
  constexpr const char* kFromTop = "\033[H\033[2J";
  const ScopedSignals signals;
  timespec next = {};
  clock_gettime(CLOCK_MONOTONIC, &next);
  while (stopped == 0) {
    std::ostringstream result;
    const ExitCode code = once(&result);
    if (code != ExitCode::kDone && code != ExitCode::kAttention && code != ExitCode::kTemporary) {
      *out << result.str() << std::flush;
      return code;
    }
    if (style.rows > 2) {
      *out << kFromTop
           << fmt::format("{} UTC, every {:g} s; Ctrl-C ends\n", FormatUtc(SystemNow()), period_s)
           << FirstLines(result.str(), style.rows - 2);
    } else {
      *out << result.str();
    }
    if (!out->flush()) return ExitCode::kTemporary;
    next = After(next, period_s);
    SleepUntil(next);
  }
  return ExitCode::kDone;
}

}  // namespace shiftmap
