// SPDX-License-Identifier: Apache-2.0
#include "mapper/cli/area_build.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <set>
#include <utility>

#include "mapper/cli/build_provenance.h"
#include "mapper/cli/build_warnings.h"
#include "mapper/cli/objections.h"
#include "mapper/cli/prior_map.h"
#include "mapper/cli/run_copies.h"
#include "mapper/cli/run_loader.h"
#include "mapper/map_edits.h"
#include "mapper/modes/mode_merging.h"
#include "mapper/selection/selector.h"
#include "mapper/tree/tree_builder.h"
#include "mapstore/cli/stop_signals.h"
#include "mapstore/cli/store_access.h"
#include "mapstore/core/count_text.h"
#include "mapstore/core/folder.h"
#include "mapstore/core/memory_bound.h"
#include "mapstore/find_version.h"

namespace shiftmap {
namespace {

// Leaves out logs that are excluded or held.
Status LeaveOutExcluded(const std::string& area,
                        const std::vector<Exclusion>& exclusions,
                        LoadedRuns* runs) {
  std::erase_if(runs->inputs, [&](const MapperInput& input) {
    const RunInfo& info = input.run.info;
    const Stamp begin = input.run.odometry.empty() ? Stamp() : BeginOf(input.run);
    const Exclusion* const exclusion =
        FindExclusion(exclusions, info.uuid, input.sha256, info.vehicle, begin);
    if (exclusion == nullptr) return false;
    runs->rejected.push_back(
        {input.name, (exclusion->held ? "held: " : "excluded: ") + exclusion->reason});
    return true;
  });
  if (!runs->inputs.empty()) return OkStatus();
  return FailedPrecondition("area '{}': no log to build from: {}", area, ReasonsOf(runs->rejected));
}

Status CheckStopped(const AreaBuildOptions& options) {
  return StopSignals::Check(fmt::format("area '{}': build", options.area));
}

// The bound on a build's memory: what was asked for, or what the process can have. [bytes]
std::int64_t MaxMemory(const AreaBuildOptions& options) {
  constexpr std::int64_t kMib = std::int64_t{1024} * 1024;
  return options.max_memory_mib ? *options.max_memory_mib * kMib : MemoryBound();
}

RunLoaderOptions LoaderOptions(const AreaBuildOptions& options,
                               const PriorMap& prior,
                               Stamp now,
                               const Context& context) {
  RunLoaderOptions loader;
  loader.area = options.area;
  loader.logs = options.logs;
  loader.known_runs = prior.known_runs;
  loader.known_visits = [&]() -> StatusOr<std::vector<EvidenceRow>> {
    SHIFTMAP_ASSIGN_OR_RETURN(MapStore store,
                              OpenStore(options.store, MapStore::Access::kReadOnly, context));
    return store.Evidence(options.area, *prior.version);
  };
  loader.missing_rest = [&](const LineRun& mapped,
                            const Run& log) -> StatusOr<std::optional<std::string>> {
    SHIFTMAP_ASSIGN_OR_RETURN(MapStore store,
                              OpenStore(options.store, MapStore::Access::kReadOnly, context));
    return MissingRest(options.area, mapped, log, &store);
  };
  loader.max_memory_bytes = MaxMemory(options);
  loader.threads = options.threads;
  if (prior.content) loader.prior_modes = prior.content->covariance.size();
  loader.limits =
      options.limits.For(prior.content ? prior.content->calibration.sensor : SensorCalibration());
  loader.lidar_scans = FieldOfViewNamed(options.field_of_view) == FieldOfViewModel::kScanPolygon;
  loader.now = now;
  loader.clock_tolerance_s = options.clock_tolerance_s;
  loader.unique_names = options.trajectories.has_value();
  loader.on_step = [&options] { return CheckStopped(options); };
  return loader;
}

// Of each log as it is in its file, by its hash.
std::map<std::string, std::int64_t> ObservationsOf(const LoadedRuns& runs) {
  std::map<std::string, std::int64_t> observations;
  for (const MapperInput& input : runs.inputs) {
    const auto dropped = runs.dropped.find(input.sha256);
    observations[input.sha256] = CountObservations(input.run) +
                                 (dropped == runs.dropped.end() ? 0 : dropped->second.observations);
  }
  return observations;
}

Status WriteTrajectories(const std::string& folder, const MapperResult& result) {
  SHIFTMAP_RETURN_IF_ERROR(MakeFolder(folder));
  for (const MappedRun& run : result.runs) {
    SHIFTMAP_RETURN_IF_ERROR(WriteTum(run.trajectory, fmt::format("{}/{}.tum", folder, run.name)));
  }
  return OkStatus();
}

StatusOr<MapperOptions> MakeMapperOptions(const AreaBuildOptions& options,
                                          const PriorMap& prior,
                                          Stamp now) {
  MapperOptions mapper_options;
  mapper_options.now = now;
  mapper_options.clock_tolerance_s = options.clock_tolerance_s;
  mapper_options.solver_kind = options.solver == "ceres" ? SolverKind::kCeres : SolverKind::kSchur;
  mapper_options.seed = options.seed;
  mapper_options.threads = options.threads;
  mapper_options.max_memory_bytes = MaxMemory(options);
  mapper_options.calibrate = !options.no_calibration;
  mapper_options.association.associate = options.anonymous == "associate";
  if (options.placement == "consensus") {
    mapper_options.confirmation.enabled = false;
  }
  mapper_options.modes.leave_rate_per_s = options.leave_rate_per_s;
  mapper_options.chains.learn = !options.no_learned_rates;
  mapper_options.chains.ledger = prior.evidence;
  StateRates(prior.edits, &mapper_options.chains);
  mapper_options.visibility = prior.visibility;
  mapper_options.older_runs = prior.older_runs;
  SHIFTMAP_ASSIGN_OR_RETURN(mapper_options.modes.selector.kind, ParseSelector(options.selector));
  mapper_options.modes.selector.seed = options.seed;
  return mapper_options;
}

LeafMerging MergingNamed(const std::string& name) {
  if (name == "none") return LeafMerging::kNone;
  return name == "mixture" ? LeafMerging::kMixture : LeafMerging::kHeavier;
}

TreeSlamOptions MakeTreeOptions(const AreaBuildOptions& options, const MapperOptions& mapper) {
  TreeSlamOptions tree = options.tree;
  tree.insertion =
      options.tree_insertion == "child" ? NewModeInsertion::kChild : NewModeInsertion::kBackTrack;
  tree.merging = MergingNamed(options.tree_merging);
  tree.leave_rate_per_s = mapper.modes.leave_rate_per_s;
  tree.field_of_view.model = FieldOfViewNamed(options.field_of_view);
  tree.anonymous = mapper.association.associate;
  tree.anonymous_landmarks.association = AssociationMethod::kJoint;
  tree.front_end = mapper.front_end;
  return tree;
}

// The runs of a build that wait.
std::vector<UnplacedRun> Unplaced(const MapperResult& result) {
  std::vector<UnplacedRun> unplaced;
  for (const AmbiguousChange& change : result.ambiguous_changes) {
    if (!change.waits) continue;
    for (const RunName& run : change.runs) {
      unplaced.push_back({run.name, run.sha256, {}});
    }
  }
  return unplaced;
}

// Runs that wait, but not of this build.
template <typename SomeRun>
std::vector<SomeRun> NotGiven(std::vector<SomeRun> runs, const std::vector<MapperInput>& inputs) {
  std::erase_if(runs, [&](const SomeRun& run) {
    return std::any_of(inputs.begin(), inputs.end(), [&](const MapperInput& input) {
      return input.sha256 == run.sha256;
    });
  });
  return runs;
}

// Shows where a build is, and stops it when a signal came.
MapperMonitor MakeMonitor(Progress* progress) {
  return [progress](const MapperProgress& now) {
    std::string text = now.phase;
    if (now.modes > 0) text += fmt::format(", {} modes", now.modes);
    if (now.cost > 0.0) text += fmt::format(", cost {:.0f}", now.cost);
    progress->Update(text, now.done);
    return StopSignals::Received().empty();
  };
}

// Fails before the build if an output cannot be written.
Status CheckOutputs(const AreaBuildOptions& options, bool dry_run) {
  if (options.area.empty()) return InvalidArgument("--area '': expected a name");
  if (options.trajectories && !dry_run) {
    SHIFTMAP_RETURN_IF_ERROR(CheckFolder(*options.trajectories));
  }
  return MapStore::CheckWritable(options.store, dry_run);
}

CommitOptions MakeCommitOptions(const AreaBuildOptions& options,
                                const PriorMap& prior,
                                const MapperResult& result) {
  CommitOptions commit;
  commit.parent = prior.version;
  commit.expected = prior.published;
  commit.publish = !options.no_publish;
  commit.replace = options.prior == "none";
  commit.states_probabilities = false;
  commit.waiting = Unplaced(result);
  if (!result.chains.empty()) commit.without_edits = prior.edits.undone_rates;
  return commit;
}

// UUIDs of reports of which rows are set aside because they are of another line of versions, but
// for those about runs that the version's line mapped.
StatusOr<std::set<std::string>> OfOtherLines(const std::string& area,
                                             VersionNumber version,
                                             MapStore* store) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto reports, store->Reports(area, version));
  SHIFTMAP_ASSIGN_OR_RETURN(const auto mapped, store->RunIdentities(area, version));
  std::set<std::string> of_others;
  for (const ReportSummary& report : reports) {
    if (mapped.contains(report.run_hash)) continue;
    for (const SetAsideRows& rows : report.set_aside) {
      if (rows.reason == SetAside::kOtherLine) of_others.insert(report.uuid);
    }
  }
  return of_others;
}

// AreaBuild::reports_set_aside of a version that is published now. Only versions beside it can have
// such reports.
StatusOr<int> CountSetAside(const std::string& area,
                            VersionNumber version,
                            std::optional<VersionNumber> before,
                            MapStore* store) {
  if (!before) return 0;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<VersionSummary> versions, store->Versions(area));
  const std::optional<VersionNumber> parent = ParentOf(versions, version);
  const bool beside =
      parent != before || std::any_of(versions.begin(), versions.end(), [&](const auto& other) {
        return other.parent == parent && other.version != version;
      });
  if (!beside) return 0;
  SHIFTMAP_ASSIGN_OR_RETURN(const auto then, OfOtherLines(area, *before, store));
  SHIFTMAP_ASSIGN_OR_RETURN(const auto now, OfOtherLines(area, version, store));
  return static_cast<int>(std::count_if(
      now.begin(), now.end(), [&](const std::string& uuid) { return !then.contains(uuid); }));
}

// A log that is older than the version counts as read whole: what the recorder appended after the
// reading would never be mapped.
Status CheckUnchanged(const std::vector<ReadLog>& files) {
  for (const ReadLog& file : files) {
    const std::optional<Stamp> changed = ChangedAt(file.path);
    if (!changed || changed == file.changed) continue;
    return MakeStatus(
        StatusCode::kAborted, "run log '{}': changed after the build had read it", file.path);
  }
  return OkStatus();
}

// A dry run does not make the prior that has the edits in force.
Status AddObjections(const AreaBuildOptions& options, const Context& context, AreaBuild* build) {
  const std::optional<VersionNumber>& parent = build->commit_options.parent;
  std::error_code error;
  const bool exists = std::filesystem::exists(options.store, error);
  if (!exists || build->result.runs.empty() || (parent && context.dry_run())) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store,
                            OpenStore(options.store, MapStore::Access::kReadOnly, context));
  SHIFTMAP_ASSIGN_OR_RETURN(
      build->objections,
      FindObjections(options.area, parent, build->provenance.runs, build->result.content, &store));
  return OkStatus();
}

}  // namespace

StatusOr<AreaBuild> MakeAreaBuild(const AreaBuildOptions& options, Context& context) {
  const Stamp now = SystemNow();
  SHIFTMAP_RETURN_IF_ERROR(CheckOutputs(options, context.dry_run()));
  SHIFTMAP_ASSIGN_OR_RETURN(PriorMap prior, LoadPrior(options, context));
  SHIFTMAP_ASSIGN_OR_RETURN(LoadedRuns runs,
                            LoadRuns(LoaderOptions(options, prior, now, context), context));
  SHIFTMAP_RETURN_IF_ERROR(LeaveOutExcluded(options.area, prior.exclusions, &runs));
  const std::map<std::string, std::int64_t> in_logs = ObservationsOf(runs);
  FollowEdits(prior.edits, &runs.inputs);
  SHIFTMAP_RETURN_IF_ERROR(LoadMemory(options, runs.inputs, context, &prior));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapperOptions mapper_options,
                            MakeMapperOptions(options, prior, now));
  const int merged =
      prior.content ? MergeModesOfPrior(mapper_options.modes, prior.stated_places, &*prior.content)
                    : 0;
  AreaBuild build;
  if (options.engine != "tree") WarnOfMoving(runs.inputs, mapper_options.front_end, context);
  build.at_two_places = AtTwoPlaces(runs.inputs, prior.known_runs);
  build.not_given = NotGiven(std::move(prior.waiting), runs.inputs);
  for (const RunRecord& run : NotGiven(std::move(prior.fallen_out), runs.inputs)) {
    build.fallen_out.push_back(run.name);
  }
  std::unique_ptr<Progress> progress = context.MakeProgress();
  const MapperMonitor monitor = MakeMonitor(progress.get());
  StatusOr<MapperResult> result =
      options.engine == "tree"
          ? BuildMapByTree(std::move(runs.inputs),
                           prior.content,
                           mapper_options,
                           MakeTreeOptions(options, mapper_options),
                           monitor)
          : BuildMap(std::move(runs.inputs), prior.content, mapper_options, monitor);
  progress.reset();
  // From here on it takes no time to speak of: what began to write ends.
  SHIFTMAP_RETURN_IF_ERROR(CheckStopped(options));
  if (const std::string more = ReasonsOf(runs.rejected);
      result.status().code() == StatusCode::kInvalidArgument && !more.empty()) {
    return InvalidArgument("{}; {}", Message(result.status()), more);
  }
  SHIFTMAP_RETURN_IF_ERROR(result.status());
  build.result = *std::move(result);
  build.result.modes_merged += merged;
  HoldControlPoints(prior.edits, &build.result);
  build.dropped = std::move(runs.dropped);
  std::vector<RejectedRun>& rejected = build.result.rejected;
  rejected.insert(rejected.end(), runs.rejected.begin(), runs.rejected.end());
  WarnOfOdd(build.result, context);
  build.provenance = MakeProvenance(options, build, in_logs);
  build.commit_options = MakeCommitOptions(options, prior, build.result);
  build.files = std::move(runs.files);
  SHIFTMAP_RETURN_IF_ERROR(AddObjections(options, context, &build));
  return build;
}

Status CommitArea(const AreaBuildOptions& options, const Context& context, AreaBuild* build) {
  SHIFTMAP_RETURN_IF_ERROR(CheckUnchanged(build->files));
  const MapperResult& result = build->result;
  if (options.trajectories && !result.runs.empty()) {
    SHIFTMAP_RETURN_IF_ERROR(WriteTrajectories(*options.trajectories, result));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(
      MapStore store,
      OpenStore(
          options.store, MapStore::Access::kReadWriteCreate, context, options.clock_tolerance_s));
  if (result.runs.empty()) return store.NoteWaiting(options.area, build->commit_options.waiting);
  SHIFTMAP_ASSIGN_OR_RETURN(const auto before, store.PublishedVersion(options.area));
  SHIFTMAP_ASSIGN_OR_RETURN(
      build->commit,
      store.Commit(options.area, result.content, build->provenance, build->commit_options));
  if (!build->commit_options.publish) return OkStatus();
  const VersionNumber version = build->commit->version;
  // The version is written, and whoever reads the ledger will see an error of it.
  build->reports_set_aside = CountSetAside(options.area, version, before, &store).value_or(0);
  if (build->reports_set_aside == 0) return OkStatus();
  context.Warn(
      fmt::format("version {} sets {} aside, of shifts on versions that it does not go on from: "
                  "shiftmap-inspect reports",
                  version.value(),
                  CountText(build->reports_set_aside, "report")));
  return OkStatus();
}

StatusOr<AreaBuild> BuildArea(const AreaBuildOptions& options, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(AreaBuild build, MakeAreaBuild(options, context));
  if (!context.dry_run()) SHIFTMAP_RETURN_IF_ERROR(CommitArea(options, context, &build));
  return build;
}

}  // namespace shiftmap
