// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/map_edit.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>

#include "mapstore/core/inert_text.h"
#include "mapstore/core/magnitude.h"

namespace shiftmap {
namespace {

constexpr std::array<std::pair<EditKind, const char*>, 9> kKinds = {{
    {EditKind::kPosition, "position"},
    {EditKind::kNewMode, "new_mode"},
    {EditKind::kControl, "control"},
    {EditKind::kRetire, "retire"},
    {EditKind::kRename, "rename"},
    {EditKind::kMerge, "merge"},
    {EditKind::kSplit, "split"},
    {EditKind::kRate, "rate"},
    {EditKind::kCalibration, "calibration"},
}};

// Of names and reasons.
constexpr std::size_t kMaxTextBytes = 1024;

// Least standard deviation of a surveyed position. [m]
constexpr double kMinSd = 1e-4;

// A landmark that moved more often would be at no place when it is seen. [1/s]
constexpr double kMaxRatePerS = 1.0;

// Most jumps that a statement about a rate counts as.
constexpr double kMaxWeight = 1e6;

Status CheckText(const char* what, const std::string& text) {
  if (text.find_first_not_of(' ') == std::string::npos) {
    return InvalidArgument("{}: empty, expected a text", what);
  }
  if (text.size() > kMaxTextBytes) {
    return InvalidArgument("{}: {} bytes, expected at most {}", what, text.size(), kMaxTextBytes);
  }
  if (InertLine(text) != text) {
    return InvalidArgument("{}: '{}', expected one line of printable text", what, InertLine(text));
  }
  return OkStatus();
}

Status CheckPosition(const MapEdit& edit) {
  for (const Eigen::Vector2d& p : {edit.p_map_landmark, edit.p_map_second}) {
    if (p.allFinite() && p.cwiseAbs().maxCoeff() <= kMaxMagnitude) continue;
    return InvalidArgument(
        "position ({}, {}), expected finite numbers up to {}", p.x(), p.y(), kMaxMagnitude);
  }
  if (!(edit.sd_m >= kMinSd && edit.sd_m <= kMaxMagnitude)) {
    return InvalidArgument("standard deviation {} m, expected at least {}", edit.sd_m, kMinSd);
  }
  return OkStatus();
}

Status CheckSplit(const MapEdit& edit) {
  SHIFTMAP_RETURN_IF_ERROR(CheckPosition(edit));
  if (edit.p_map_landmark == edit.p_map_second) {
    return InvalidArgument("positions: both are the same, expected two places");
  }
  for (const std::string& run : edit.first_runs) {
    const std::vector<std::string>& second = edit.second_runs;
    if (std::find(second.begin(), second.end(), run) == second.end()) continue;
    return InvalidArgument("run '{}': is said of both places, expected one", InertLine(run));
  }
  return OkStatus();
}

}  // namespace

const char* NameOf(EditKind kind) {
  for (const auto& [known, name] : kKinds) {
    if (known == kind) return name;
  }
  return "";
}

std::optional<EditKind> EditKindNamed(const std::string& name) {
  for (const auto& [kind, known] : kKinds) {
    if (known == name) return kind;
  }
  return std::nullopt;
}

Status ValidateEdit(const MapEdit& edit) {
  SHIFTMAP_RETURN_IF_ERROR(CheckText("author", edit.author));
  SHIFTMAP_RETURN_IF_ERROR(CheckText("reason", edit.reason));
  switch (edit.kind) {
    case EditKind::kPosition:
    case EditKind::kNewMode:
    case EditKind::kControl:
      return CheckPosition(edit);
    case EditKind::kSplit:
      return CheckSplit(edit);
    case EditKind::kRename:
      return CheckText("new name", edit.new_name.text());
    case EditKind::kRate:
      if (!(edit.rate_per_s >= kMinMagnitude && edit.rate_per_s <= kMaxRatePerS)) {
        return InvalidArgument(
            "rate {} per s, expected above 0 and up to {}", edit.rate_per_s, kMaxRatePerS);
      }
      if (!(edit.weight > 0.0 && edit.weight <= kMaxWeight)) {
        return InvalidArgument("weight {}, expected above 0 and up to {}", edit.weight, kMaxWeight);
      }
      return OkStatus();
    case EditKind::kCalibration:
      return CheckText("vehicle", edit.vehicle);
    case EditKind::kRetire:
    case EditKind::kMerge:
      return OkStatus();
  }
  return OkStatus();
}

Status ValidateUndo(const EditUndo& undo) {
  SHIFTMAP_RETURN_IF_ERROR(CheckText("author", undo.author));
  return CheckText("reason", undo.reason);
}

LandmarkNames::LandmarkNames(const std::vector<MapEdit>& held) {
  for (const MapEdit& edit : held) Add(edit);
}

void LandmarkNames::Add(const MapEdit& rename) {
  if (rename.kind != EditKind::kRename) return;
  landmarks_[rename.new_name] = rename.landmark;
  names_[rename.landmark] = rename.new_name;
}

Signature LandmarkNames::Landmark(const Signature& name) const {
  const auto found = landmarks_.find(name);
  return found == landmarks_.end() ? name : found->second;
}

Signature LandmarkNames::Name(const Signature& landmark) const {
  const auto found = names_.find(landmark);
  return found == names_.end() ? landmark : found->second;
}

std::map<Signature, Signature> LandmarkNames::Aliases() const {
  std::map<Signature, Signature> aliases = names_;
  for (const auto& [name, landmark] : landmarks_) {
    const Signature& last = names_.at(landmark);
    if (name != last) aliases[name] = last;
  }
  return aliases;
}

}  // namespace shiftmap
