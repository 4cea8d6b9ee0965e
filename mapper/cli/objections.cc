// SPDX-License-Identifier: Apache-2.0
#include "mapper/cli/objections.h"

#include <fmt/format.h>

#include <algorithm>

#include "mapper/map_edits.h"
#include "mapstore/core/inert_text.h"

namespace shiftmap {
namespace {

// Of a version without a parent; one with a parent has the runs of its line.
StatusOr<std::vector<std::string>> FindLostRuns(const std::string& area,
                                                VersionNumber published,
                                                const std::vector<RunRecord>& built,
                                                MapStore* store) {
  std::vector<std::string> lost;
  SHIFTMAP_ASSIGN_OR_RETURN(const auto exclusions, store->Exclusions(area));
  SHIFTMAP_ASSIGN_OR_RETURN(const auto runs, store->LineRuns(area, published));
  for (const LineRun& of_line : runs) {
    const RunRecord& run = of_line.run;
    const bool there = std::any_of(built.begin(), built.end(), [&](const RunRecord& of) {
      return of.sha256 == run.sha256 || of.identity() == run.identity();
    });
    if (there || FindExclusion(exclusions, run) != nullptr) {
      continue;
    }
    lost.push_back(fmt::format("run '{}' is not in the new map, its log is not there or left out",
                               InertLine(run.name)));
  }
  return lost;
}

}  // namespace

StatusOr<std::vector<std::string>> FindObjections(const std::string& area,
                                                  const std::optional<VersionNumber>& parent,
                                                  const std::vector<RunRecord>& runs,
                                                  const MapContent& content,
                                                  MapStore* store) {
  std::vector<std::string> objections;
  SHIFTMAP_ASSIGN_OR_RETURN(const auto published, store->PublishedVersion(area));
  if (!published) return objections;
  std::vector<MapEdit> held;
  if (parent) {
    SHIFTMAP_ASSIGN_OR_RETURN(held, store->EditsOf(area, *parent));
  } else {
    SHIFTMAP_ASSIGN_OR_RETURN(objections, FindLostRuns(area, *published, runs, store));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const auto edits, store->EditsOf(area, *published));
  for (const MapEdit& edit : edits) {
    const bool holds = std::any_of(
        held.begin(), held.end(), [&](const MapEdit& other) { return other.id == edit.id; });
    if (edit.undone || holds) continue;
    const bool of_vehicle = edit.kind == EditKind::kCalibration;
    objections.push_back(fmt::format("edit {} ({} '{}') is not in the new map, to be made again",
                                     edit.id.value(),
                                     NameOf(edit.kind),
                                     InertLine(of_vehicle ? edit.vehicle : edit.signature.text())));
  }
  const Status fit = CheckControlPoints(MakeBuildEdits(held).control_points, content);
  if (!fit.ok()) objections.push_back(Message(fit));
  return objections;
}

}  // namespace shiftmap
