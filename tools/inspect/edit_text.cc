// SPDX-License-Identifier: Apache-2.0
#include "tools/inspect/edit_text.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "mapstore/core/count_text.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/core/mode_name.h"
#include "tools/inspect/store_arguments.h"

namespace shiftmap {
namespace {

std::string PositionText(const MapEdit& edit) {
  return fmt::format("at ({:.3f}, {:.3f}) m, sd {:.3f} m",
                     edit.p_map_landmark.x(),
                     edit.p_map_landmark.y(),
                     edit.sd_m);
}

// "mode 2 of 'L07' split: mode 2 at (1.000, 2.000) m (1 run), mode 4 at (3.000, 2.000) m (2 runs),
// sd 0.050 m"
std::string SplitText(const MapEdit& edit, const std::string& name) {
  const auto place =
      [](const std::string& mode, const Eigen::Vector2d& p, const std::vector<std::string>& runs) {
        std::string text = fmt::format("{} at ({:.3f}, {:.3f}) m", mode, p.x(), p.y());
        if (runs.empty()) return text;
        return text + fmt::format(" ({})", CountText(runs.size(), "run"));
      };
  const std::string second = edit.into == kAbsent ? "a new mode" : ModeName(edit.into);
  return fmt::format("{} of {} split: {}, {}, sd {:.3f} m",
                     ModeName(edit.mode),
                     name,
                     place(ModeName(edit.mode), edit.p_map_landmark, edit.first_runs),
                     place(second, edit.p_map_second, edit.second_runs),
                     edit.sd_m);
}

void AddPosition(const MapEdit& edit, Json* json) {
  (*json)["mode"] = edit.mode.value();
  (*json)["x_m"] = edit.p_map_landmark.x();
  (*json)["y_m"] = edit.p_map_landmark.y();
  (*json)["sd_m"] = edit.sd_m;
}

}  // namespace

Json EditJson(const MapEdit& edit) {
  Json json = {{"id", edit.id.value() == 0 ? Json(nullptr) : Json(edit.id.value())},
               {"kind", NameOf(edit.kind)},
               {"author", edit.author},
               {"reason", edit.reason},
               {"made_s", ToSecondsSinceEpoch(edit.made)},
               {"version", edit.version ? Json(edit.version->value()) : Json(nullptr)}};
  if (edit.kind == EditKind::kCalibration) {
    json["vehicle"] = edit.vehicle;
    json["since_s"] = ToSecondsSinceEpoch(edit.since);
  } else {
    json["signature"] = edit.signature.text();
  }
  switch (edit.kind) {
    case EditKind::kPosition:
    case EditKind::kNewMode:
    case EditKind::kControl:
      AddPosition(edit, &json);
      break;
    case EditKind::kRename:
      json["new_name"] = edit.new_name.text();
      break;
    case EditKind::kMerge:
      json["mode"] = edit.mode.value();
      json["into"] = edit.into.value();
      break;
    case EditKind::kSplit:
      AddPosition(edit, &json);
      json["second_mode"] = edit.into.value();
      json["second_x_m"] = edit.p_map_second.x();
      json["second_y_m"] = edit.p_map_second.y();
      json["first_runs"] = edit.first_runs;
      json["second_runs"] = edit.second_runs;
      break;
    case EditKind::kRate:
      json["rate_per_s"] = edit.rate_per_s;
      json["weight"] = edit.weight;
      break;
    case EditKind::kRetire:
    case EditKind::kCalibration:
      break;
  }
  json["undone"] = nullptr;
  if (edit.undone) {
    json["undone"] = {{"author", edit.undone->author},
                      {"reason", edit.undone->reason},
                      {"when_s", ToSecondsSinceEpoch(edit.undone->when)}};
  }
  return json;
}

std::string EditText(const MapEdit& edit) {
  const std::string name = "'" + InertLine(edit.signature.text()) + "'";
  switch (edit.kind) {
    case EditKind::kPosition:
      return fmt::format("position of {} mode {} {}", name, edit.mode.value(), PositionText(edit));
    case EditKind::kNewMode:
      return edit.mode == kAbsent
                 ? fmt::format("new mode of {} {}", name, PositionText(edit))
                 : fmt::format("new mode {} of {} {}", edit.mode.value(), name, PositionText(edit));
    case EditKind::kControl:
      return edit.mode == kAbsent
                 ? fmt::format("control point {} {}", name, PositionText(edit))
                 : fmt::format(
                       "control point {} mode {} {}", name, edit.mode.value(), PositionText(edit));
    case EditKind::kRetire:
      return name + " retired";
    case EditKind::kRename:
      return fmt::format("{} renamed '{}'", name, InertLine(edit.new_name.text()));
    case EditKind::kMerge:
      return fmt::format(
          "mode {} of {} is part of mode {}", edit.mode.value(), name, edit.into.value());
    case EditKind::kSplit:
      return SplitText(edit, name);
    case EditKind::kRate:
      return fmt::format(
          "rate of {} {:.3g} per s, weight {:g}", name, edit.rate_per_s, edit.weight);
    case EditKind::kCalibration:
      return fmt::format("calibration of vehicle '{}' forgotten since {}",
                         InertLine(edit.vehicle),
                         TimeText(edit.since));
  }
  return "";
}

std::string EditLine(const MapEdit& edit) {
  std::string line = fmt::format("edit {}: {}, {} UTC by {} ({})",
                                 edit.id.value(),
                                 EditText(edit),
                                 TimeText(edit.made),
                                 InertLine(edit.author),
                                 InertLine(edit.reason));
  if (edit.undone) {
    line += fmt::format("; taken back {} UTC by {} ({})",
                        TimeText(edit.undone->when),
                        InertLine(edit.undone->author),
                        InertLine(edit.undone->reason));
  }
  return line + "\n";
}

}  // namespace shiftmap
