// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/nearest_name.h"

#include <algorithm>
#include <utility>

#include "mapstore/core/inert_text.h"

namespace shiftmap {
namespace {

constexpr double kMissingEnd = 0.5;     // Of the name, however long.
constexpr std::size_t kPartLength = 4;  // Of a text that may be the middle of a name.
constexpr std::size_t kMaxLength = 256;

// Edits from the text to the name, where an end of the name that is missing costs kMissingEnd.
double Distance(std::string_view text, std::string_view name) {
  std::vector<int> before(name.size() + 1);
  std::vector<int> last(name.size() + 1);
  std::vector<int> row(name.size() + 1);
  for (std::size_t j = 0; j <= name.size(); ++j) row[j] = static_cast<int>(j);
  for (std::size_t i = 1; i <= text.size(); ++i) {
    before = std::exchange(last, row);
    row[0] = static_cast<int>(i);
    for (std::size_t j = 1; j <= name.size(); ++j) {
      const int substituted = last[j - 1] + (text[i - 1] == name[j - 1] ? 0 : 1);
      row[j] = std::min({last[j] + 1, row[j - 1] + 1, substituted});
      const bool swapped =
          i > 1 && j > 1 && text[i - 1] == name[j - 2] && text[i - 2] == name[j - 1];
      if (swapped) row[j] = std::min(row[j], before[j - 2] + 1);
    }
  }
  double distance = row.back();
  if (text.size() >= kPartLength) {
    distance = std::min(distance, kMissingEnd + *std::min_element(row.begin(), row.end()));
    if (name.find(text) != std::string_view::npos) distance = std::min(distance, 2 * kMissingEnd);
  }
  return distance;
}

std::string_view WithoutDashes(std::string_view name) {
  return name.substr(std::min(name.find_first_not_of('-'), name.size()));
}

}  // namespace

std::optional<std::string> NearestName(std::string_view text,
                                       const std::vector<std::string>& names) {
  const std::string_view wanted = WithoutDashes(text);
  if (wanted.empty() || wanted.size() > kMaxLength) return std::nullopt;
  const double allowed = std::max(1.0, static_cast<double>(wanted.size()) / 3.0) + kMissingEnd;
  double least = allowed;
  const std::string* nearest = nullptr;
  for (const std::string& name : names) {
    const std::string_view bare = WithoutDashes(name);
    if (bare.empty() || bare.size() > kMaxLength) continue;
    const double distance = Distance(wanted, bare);
    if (distance < least || (distance == least && nearest == nullptr)) {
      // A name of which nothing is left is no suggestion.
      if (distance >= static_cast<double>(std::max(wanted.size(), bare.size()))) continue;
      least = distance;
      nearest = &name;
    }
  }
  if (nearest == nullptr) return std::nullopt;
  return *nearest;
}

std::string DidYouMean(std::string_view text, const std::vector<std::string>& names) {
  const std::optional<std::string> nearest = NearestName(text, names);
  return nearest ? "; did you mean '" + InertLine(*nearest) + "'?" : "";
}

}  // namespace shiftmap
