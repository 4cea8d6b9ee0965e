// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/check/finding.h"

#include <fmt/format.h>

#include <algorithm>

namespace shiftmap {

const char* SeverityName(Severity severity) {
  switch (severity) {
    case Severity::kNote:
      return "note";
    case Severity::kWarning:
      return "warning";
    case Severity::kError:
      return "error";
  }
  return "";
}

std::string TimeInRun(Stamp stamp, Stamp begin) {
  return fmt::format("{:.3f} s into the run", ToSeconds(stamp - begin));
}

std::string SomeNames(const std::vector<std::string>& names) {
  constexpr std::size_t kShown = 10;
  std::string text;
  for (std::size_t i = 0; i < std::min(kShown, names.size()); ++i) {
    text += (i == 0 ? "'" : ", '") + names[i] + "'";
  }
  if (names.size() > kShown) text += fmt::format(" and {} more", names.size() - kShown);
  return text;
}

}  // namespace shiftmap
