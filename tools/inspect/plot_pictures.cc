// SPDX-License-Identifier: Apache-2.0
#include "tools/inspect/plot_pictures.h"

#include <filesystem>
#include <optional>

#include "localizer/recording/shift_recording.h"
#include "mapstore/core/clock.h"
#include "mapstore/core/parse_whole.h"
#include "mapstore/find_version.h"
#include "mapstore/map/frame_change.h"
#include "tools/eval/trajectory_error.h"
#include "tools/inspect/landmark_history.h"
#include "tools/plot/change_plot.h"
#include "tools/plot/consistency_plot.h"
#include "tools/plot/history_plot.h"
#include "tools/plot/map_plot.h"
#include "tools/plot/modes_plot.h"
#include "tools/plot/rates_plot.h"
#include "tools/plot/trajectory_plot.h"

namespace shiftmap {
namespace {

// Of a long line of versions, only the newest are looked into.
constexpr std::size_t kMostVersions = 400;

Json AboutMap(const MapSnapshot& map) {
  return {{"area", map.area()}, {"version", map.version().value()}};
}

// The runs that a version was built from, and those of its ancestors, in the frame of that version.
struct LineRuns {
  std::vector<RunRecord> own;  // Of a version of edits: those of the build that it rests on.
  std::vector<RunRecord> earlier;
};

StatusOr<LineRuns> RunsOfLine(const std::string& area, VersionNumber version, MapStore* store) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto versions, store->Versions(area));
  SHIFTMAP_ASSIGN_OR_RETURN(Provenance own, store->LoadProvenance(area, version));
  LineRuns runs{std::move(own.runs), {}};
  const VersionSummary* at = FindVersion(versions, version);
  Se2 T_version_at;
  for (std::size_t i = 0; i < kMostVersions && at != nullptr && at->parent; ++i) {
    SHIFTMAP_ASSIGN_OR_RETURN(const Se2 T_at_parent, store->FrameStep(area, at->version));
    T_version_at = T_version_at * T_at_parent;
    at = FindVersion(versions, *at->parent);
    if (at == nullptr) break;
    SHIFTMAP_ASSIGN_OR_RETURN(Provenance provenance, store->LoadProvenance(area, at->version));
    std::vector<RunRecord>& to = runs.own.empty() ? runs.own : runs.earlier;
    for (RunRecord& run : provenance.runs) {
      MoveTrajectory(T_version_at, &run.trajectory);
      to.push_back(std::move(run));
    }
  }
  return runs;
}

StatusOr<VersionNumber> ParseVersion(const std::string& text) {
  const std::optional<std::int64_t> number = ParseWhole<std::int64_t>(text);
  if (!number) return InvalidArgument("plot diff: '{}', expected a version number", text);
  return VersionNumber(*number);
}

std::string StemOf(const std::string& path) { return std::filesystem::path(path).stem().string(); }

// The truth in the frame of the map: as it is, or moved onto an estimate.
StatusOr<std::vector<StampedPose>> ReadTruth(const PictureArguments& arguments,
                                             const std::vector<StampedPose>& estimate) {
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<StampedPose> truth, ReadTum(arguments.truth));
  if (!arguments.align) return truth;
  const StatusOr<TrajectoryError> error = EvaluateTrajectory(estimate, truth, {.align = true});
  SHIFTMAP_RETURN_IF_ERROR(Annotate(error.status(), "truth '{}'", arguments.truth));
  MoveTrajectory(error->T_truth_estimate.Inverse(), &truth);
  return truth;
}

}  // namespace

StatusOr<Picture> DrawMap(const PictureArguments& arguments, const Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments.store, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, LoadMap(arguments.store, &store, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const LineRuns runs, RunsOfLine(map.area(), map.version(), &store));
  return Picture{PlotMap(map, runs.own, runs.earlier), AboutMap(map)};
}

StatusOr<Picture> DrawModes(const PictureArguments& arguments, const Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments.store, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, LoadMap(arguments.store, &store, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::size_t index, FindLandmark(map, arguments.subjects[0]));
  return Picture{PlotModes(map, map.groups()[index]), AboutMap(map)};
}

StatusOr<Picture> DrawHistory(const PictureArguments& arguments, const Context& context) {
  const StoreArguments& of = arguments.store;
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(of, context));
  const Signature signature(arguments.subjects[0]);
  HistoryOptions options;
  if (of.version) options.version = VersionNumber(*of.version);
  if (of.at_s) options.at = StampFromSeconds(*of.at_s);
  if (of.known_s) options.known = StampFromSeconds(*of.known_s);
  options.choose_track = [&](const std::vector<VisitSpan>& visits, Stamp version) {
    // Without visits, what is stated fades until now.
    const Stamp end = visits.empty() ? SystemNow() : version;
    return HistoryTimes(visits, version, options.at.value_or(end));
  };
  const StatusOr<LandmarkHistory> history =
      LoadLandmarkHistory(&store, of.area, signature, options);
  if (!history.ok()) {
    return NameLandmark(history.status(), of, signature.text(), &store, context);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const auto versions, store.Versions(of.area));
  return Picture{PlotHistory(*history, versions),
                 {{"area", history->area},
                  {"version", history->version.value()},
                  {"signature", signature.text()}}};
}

StatusOr<Picture> DrawDiff(const PictureArguments& arguments, const Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionNumber from, ParseVersion(arguments.subjects[0]));
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionNumber to, ParseVersion(arguments.subjects[1]));
  const std::string& area = arguments.store.area;
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments.store, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot after, LoadAsBuilt(area, to, &store));
  SHIFTMAP_ASSIGN_OR_RETURN(const EarlierMap before, LoadEarlier(from, after, &store));
  return Picture{PlotDiff(before, after),
                 {{"area", area}, {"from", from.value()}, {"to", to.value()}}};
}

StatusOr<Picture> DrawTrajectories(const PictureArguments& arguments, const Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments.store, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, LoadMap(arguments.store, &store, context));
  std::vector<NamedTrajectory> estimates;
  for (const std::string& path : arguments.subjects) {
    SHIFTMAP_ASSIGN_OR_RETURN(std::vector<StampedPose> poses, ReadTum(path));
    if (poses.empty()) return InvalidArgument("trajectory '{}': no pose", path);
    estimates.push_back({StemOf(path), std::move(poses)});
  }
  std::optional<NamedTrajectory> truth;
  if (!arguments.truth.empty()) {
    SHIFTMAP_ASSIGN_OR_RETURN(std::vector<StampedPose> poses,
                              ReadTruth(arguments, estimates.front().poses));
    truth = NamedTrajectory{StemOf(arguments.truth), std::move(poses)};
  }
  SHIFTMAP_ASSIGN_OR_RETURN(std::string svg, PlotTrajectories(map, estimates, truth));
  return Picture{std::move(svg), AboutMap(map)};
}

StatusOr<Picture> DrawConsistency(const PictureArguments& arguments, const Context&) {
  SHIFTMAP_ASSIGN_OR_RETURN(const ShiftRecording recording,
                            ReadShiftRecording(arguments.subjects[0]));
  if (recording.poses.empty()) {
    return InvalidArgument("recording '{}': the shift has no pose", arguments.subjects[0]);
  }
  std::optional<std::vector<StampedPose>> truth;
  if (!arguments.truth.empty()) {
    std::vector<StampedPose> estimate;
    for (const live::PoseEvent& pose : recording.poses) {
      estimate.push_back({pose.stamp, pose.pose.T_map_vehicle});
    }
    SHIFTMAP_ASSIGN_OR_RETURN(truth, ReadTruth(arguments, estimate));
  }
  const std::vector<ScanConsistency> scans = ScansOf(recording);
  return Picture{PlotConsistency(StemOf(arguments.subjects[0]), scans, truth),
                 {{"scans", scans.size()}}};
}

StatusOr<Picture> DrawRates(const PictureArguments& arguments, const Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments.store, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, LoadMap(arguments.store, &store, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<EvidenceRow> evidence,
                            store.Evidence(map.area(), map.version()));
  return Picture{PlotRates(map, EstimateMoveRates(map, evidence)), AboutMap(map)};
}

StatusOr<Picture> DrawNight(const PictureArguments& arguments, const Context& context) {
  const std::string& area = arguments.store.area;
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments.store, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionNumber version, SelectVersion(arguments.store, &store));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, LoadAsBuilt(area, version, &store));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<VersionNumber> parent,
                            ParentOf(area, version, &store));
  Night night;
  if (parent) {
    SHIFTMAP_ASSIGN_OR_RETURN(night.parent, LoadEarlier(*parent, map, &store));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(Provenance provenance, store.LoadProvenance(area, version));
  night.mapped = std::move(provenance.runs);
  SHIFTMAP_ASSIGN_OR_RETURN(night.waiting, store.WaitingRuns(area));
  SHIFTMAP_ASSIGN_OR_RETURN(night.exclusions, store.Exclusions(area));
  return Picture{PlotNight(map, night), AboutMap(map)};
}

}  // namespace shiftmap
