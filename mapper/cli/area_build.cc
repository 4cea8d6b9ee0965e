// SPDX-License-Identifier: Apache-2.0
#include "mapper/cli/area_build.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "mapper/cli/build_report.h"
#include "mapper/cli/objections.h"
#include "mapper/cli/run_copies.h"
#include "mapper/cli/run_loader.h"
#include "mapper/frontend/mapping_run.h"
#include "mapper/map_edits.h"
#include "mapper/selection/selector.h"
#include "mapper/tree/tree_builder.h"
#include "mapstore/cli/stop_signals.h"
#include "mapstore/cli/store_access.h"
#include "mapstore/cli/version.h"
#include "mapstore/core/count_text.h"
#include "mapstore/core/folder.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/core/memory_bound.h"
#include "mapstore/prior_version.h"

namespace shiftmap {
namespace {

// Poses of a run that the store keeps for pictures.
constexpr std::size_t kStoredPoses = 2000;

// The version that a build starts from.
struct PriorMap {
  std::optional<VersionNumber> version;
  std::optional<VersionNumber> published;  // Newer than `version` if it rests on excluded runs.
  std::optional<MapContent> content;
  std::vector<LineRun> known_runs;         // Those that are in it already.
  std::vector<UnplacedRun> waiting;        // Of earlier builds.
  std::vector<RunRecord> fallen_out;       // Of versions newer than `version`.
  std::vector<Exclusion> exclusions;       // What an operator took out of the area's memory.
  std::vector<EvidenceRow> evidence;       // Of the line of versions, to learn the chains from.
  std::vector<ModeVisibility> visibility;  // Of the same line's runs.
  std::vector<RunRecord> older_runs;       // The newest of that line.
  BuildEdits edits;
};

// Goes on from the edits that are in force. A prior that is named is taken as it is.
Status TakeEditsIn(const AreaBuildOptions& options,
                   const Context& context,
                   MapStore* store,
                   PriorMap* prior) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> edits, store->Edits(options.area));
  if (edits.empty()) return OkStatus();
  if (prior->published && !context.dry_run()) {
    SHIFTMAP_ASSIGN_OR_RETURN(
        MapStore writer,
        OpenStore(options.store, MapStore::Access::kReadWrite, context, options.clock_tolerance_s));
    SHIFTMAP_ASSIGN_OR_RETURN(prior->version,
                              writer.WithEditsInForce(options.area, *prior->version));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> held,
                            store->EditsOf(options.area, *prior->version));
  prior->edits = MakeBuildEdits(held);
  return OkStatus();
}

std::optional<VersionNumber> ParentOf(VersionNumber version,
                                      const std::vector<VersionSummary>& versions) {
  const auto summary = std::find_if(versions.begin(), versions.end(), [&](const auto& other) {
    return other.version == version;
  });
  return summary == versions.end() ? std::nullopt : summary->parent;
}

// Runs of the published version's line that its prior does not rest on, but for excluded ones.
Status FindFallenOut(const AreaBuildOptions& options, MapStore* store, PriorMap* prior) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<VersionSummary> versions,
                            store->Versions(options.area));
  for (std::optional<VersionNumber> at = prior->published; at && *at != *prior->version;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const Provenance provenance,
                              store->LoadProvenance(options.area, *at));
    for (const RunRecord& run : provenance.runs) {
      const bool rests =
          std::any_of(prior->known_runs.begin(), prior->known_runs.end(), [&](const LineRun& of) {
            return of.run.sha256 == run.sha256;
          });
      const bool excluded =
          FindExclusion(prior->exclusions, run.identity(), run.vehicle, run.begin) != nullptr;
      if (!rests && !excluded) prior->fallen_out.push_back(run);
    }
    at = ParentOf(*at, versions);
  }
  return OkStatus();
}

StatusOr<PriorMap> LoadPrior(const AreaBuildOptions& options, const Context& context) {
  PriorMap prior;
  std::error_code error;
  const bool exists = std::filesystem::exists(options.store, error);
  const bool needed = options.prior != "none" && options.prior != "published";
  if (!exists && !needed) return prior;
  // Opened even without a prior: what is no store is better known before the work than after it.
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store,
                            OpenStore(options.store, MapStore::Access::kReadOnly, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<AreaSummary> areas, store.Areas());
  const bool known = std::any_of(areas.begin(), areas.end(), [&](const AreaSummary& area) {
    return area.area == options.area;
  });
  if (known) {
    SHIFTMAP_ASSIGN_OR_RETURN(prior.exclusions, store.Exclusions(options.area));
    SHIFTMAP_ASSIGN_OR_RETURN(prior.waiting, store.WaitingRuns(options.area));
  }
  if (options.prior == "none") return prior;
  if (options.prior == "published") {
    SHIFTMAP_ASSIGN_OR_RETURN(prior.published, store.PublishedVersion(options.area));
    if (!prior.published) return prior;
    SHIFTMAP_ASSIGN_OR_RETURN(
        prior.version,
        FindPriorVersion(
            options.area,
            *prior.published,
            [&](const std::string& line) { context.Warn(line + ": it is no prior"); },
            &store));
    if (!prior.version && !options.starts_anew) {
      return FailedPrecondition(
          "area '{}': every stored version of the line rests on what was taken out; --prior none "
          "with the logs of all runs that count starts anew",
          options.area);
    }
    if (!prior.version) return prior;
  } else {
    prior.version = VersionNumber(std::stoll(options.prior));
  }
  SHIFTMAP_RETURN_IF_ERROR(TakeEditsIn(options, context, &store, &prior));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot snapshot,
                            store.LoadVersion(options.area, *prior.version));
  prior.content = snapshot.content();
  SHIFTMAP_ASSIGN_OR_RETURN(prior.known_runs, store.LineRuns(options.area, *prior.version));
  SHIFTMAP_RETURN_IF_ERROR(FindFallenOut(options, &store, &prior));
  return prior;
}

// One line for each vehicle that was in two runs at one time, of a build or of one and the map.
std::vector<std::string> AtTwoPlaces(const std::vector<MapperInput>& inputs,
                                     const std::vector<LineRun>& known_runs) {
  struct Stay {
    const std::string& vehicle;
    const std::string& run;
    Stamp begin;
    Stamp end;
  };
  std::vector<Stay> stays;
  for (const MapperInput& input : inputs) {
    if (input.run.odometry.empty()) continue;
    stays.push_back({input.run.info.vehicle, input.name, BeginOf(input.run), EndOf(input.run)});
  }
  const std::size_t of_build = stays.size();
  for (const auto& [run, version, committed] : known_runs) {
    stays.push_back({run.vehicle, run.name, run.begin, run.end});
  }
  std::map<std::string, std::string> lines;
  for (std::size_t i = 0; i < of_build; ++i) {
    const Stay& a = stays[i];
    for (std::size_t k = i + 1; k < stays.size() && !a.vehicle.empty(); ++k) {
      const Stay& b = stays[k];
      if (a.vehicle != b.vehicle || a.begin >= b.end || b.begin >= a.end) continue;
      lines.try_emplace(a.vehicle,
                        fmt::format("vehicle '{}' is in runs '{}' and '{}' at {} UTC: a clock is "
                                    "wrong, or two vehicles have one name",
                                    a.vehicle,
                                    a.run,
                                    b.run,
                                    FormatUtc(std::max(a.begin, b.begin))));
    }
  }
  std::vector<std::string> result;
  for (auto& [vehicle, line] : lines) result.push_back(std::move(line));
  return result;
}

// Leaves out logs that are excluded or held.
Status LeaveOutExcluded(const std::string& area,
                        const std::vector<Exclusion>& exclusions,
                        LoadedRuns* runs) {
  std::erase_if(runs->inputs, [&](const MapperInput& input) {
    const RunInfo& info = input.run.info;
    const Stamp begin = input.run.odometry.empty() ? Stamp() : BeginOf(input.run);
    const Exclusion* exclusion = FindExclusion(exclusions, input.sha256, info.vehicle, begin);
    if (exclusion == nullptr && !info.uuid.empty()) {
      exclusion = FindExclusion(exclusions, info.uuid, info.vehicle, begin);
    }
    if (exclusion == nullptr) return false;
    runs->rejected.push_back(
        {input.name, (exclusion->held ? "held: " : "excluded: ") + exclusion->reason});
    return true;
  });
  if (!runs->inputs.empty()) return OkStatus();
  return FailedPrecondition("area '{}': no log to build from; first: run '{}': {}",
                            area,
                            runs->rejected.front().name,
                            runs->rejected.front().reason);
}

// The newest runs of a version and its ancestors, with their trajectories.
// @param without_runs  Hashes and identities.
StatusOr<std::vector<RunRecord>> LoadOlderRuns(const std::string& area,
                                               VersionNumber version,
                                               const std::set<std::string>& without_runs,
                                               MapStore* store) {
  constexpr std::size_t kMostRuns = 500;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<VersionSummary> versions, store->Versions(area));
  std::vector<RunRecord> runs;
  std::optional<VersionNumber> at = version;
  for (auto of = versions.rbegin(); of != versions.rend() && runs.size() < kMostRuns; ++of) {
    if (!at || of->version != *at) continue;
    at = of->parent;
    SHIFTMAP_ASSIGN_OR_RETURN(const Provenance provenance,
                              store->LoadProvenance(area, of->version));
    for (const RunRecord& run : provenance.runs) {
      if (run.trajectory.empty() || without_runs.contains(run.sha256) ||
          without_runs.contains(run.identity())) {
        continue;
      }
      runs.push_back(run);
    }
  }
  return runs;
}

// Loads what the ledger says of the landmarks and of where they are visible from, but not of the
// runs of the build: it sees their visits itself, with all modes, and none may count twice. The
// prior map gets the probabilities of when they begin.
Status LoadMemory(const AreaBuildOptions& options,
                  const std::vector<MapperInput>& inputs,
                  const Context& context,
                  PriorMap* prior) {
  if (!prior->version) return OkStatus();
  std::set<std::string> runs;
  Stamp begin = Stamp::max();
  for (const MapperInput& input : inputs) {
    if (!input.run.odometry.empty()) begin = std::min(begin, BeginOf(input.run));
    runs.insert(input.sha256);
    if (!input.run.info.uuid.empty()) runs.insert(input.run.info.uuid);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store,
                            OpenStore(options.store, MapStore::Access::kReadOnly, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map,
                            store.LoadAt(options.area, prior->version, begin));
  prior->content = map.content();
  SHIFTMAP_ASSIGN_OR_RETURN(prior->visibility,
                            store.MappedVisibility(options.area, *prior->version, runs));
  if (options.no_learned_rates) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(prior->evidence, store.Evidence(options.area, *prior->version, runs));
  SHIFTMAP_ASSIGN_OR_RETURN(prior->older_runs,
                            LoadOlderRuns(options.area, *prior->version, runs, &store));
  return OkStatus();
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

std::vector<StampedPose> Thinned(const std::vector<StampedPose>& trajectory) {
  const std::size_t step = trajectory.size() / kStoredPoses + 1;
  std::vector<StampedPose> thinned;
  for (std::size_t i = 0; i < trajectory.size(); i += step) thinned.push_back(trajectory[i]);
  return thinned;
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

// What became of the runs, for whoever looks at the version later.
Json OutcomeJson(const MapperResult& result,
                 const std::vector<std::string>& at_two_places,
                 const std::map<std::string, std::int64_t>& in_logs) {
  double chi2 = 0.0;
  std::int64_t observations = 0;
  std::int64_t outliers = 0;
  for (const MappedRun& run : result.runs) {
    chi2 += run.chi2;
    observations += run.observations;
    outliers += run.outliers;
  }
  return {{"chi2", chi2},
          {"observations", observations},
          {"outliers", outliers},
          {"modes_created", result.modes_created},
          {"modes_merged", result.modes_merged},
          {"left_out", LeftOutLines(result)},
          {"waiting", WaitingLines(result)},
          {"at_two_places", at_two_places},
          {"observations_of_logs", in_logs}};
}

Provenance MakeProvenance(const AreaBuildOptions& options,
                          const AreaBuild& build,
                          const std::map<std::string, std::int64_t>& in_logs) {
  const MapperResult& result = build.result;
  Provenance provenance;
  provenance.tool = "shiftmap-mapper " + SoftwareVersion();
  Json configuration = Json{{"revision", SoftwareRevision()},
                            {"selector", options.selector},
                            {"engine", options.engine},
                            {"poses", options.engine == "tree" ? "filtered" : "smoothed"},
                            {"solver", options.solver},
                            {"prior", options.prior},
                            {"anonymous", options.anonymous},
                            {"placement", options.placement},
                            {"calibrate", !options.no_calibration},
                            {"leave_rate_per_s", options.leave_rate_per_s},
                            {"learned_rates", !options.no_learned_rates},
                            {"vehicles", VehiclesJson(result.vehicles)},
                            {"outcome", OutcomeJson(result, build.at_two_places, in_logs)}};
  if (!options.night.empty()) configuration["night"] = options.night;
  if (options.engine == "tree") {
    configuration["tree"] = {{"field_of_view", options.field_of_view},
                             {"leaves", options.tree.max_leaves},
                             {"alpha", options.tree.alpha},
                             {"update_ungated", options.tree.update_ungated},
                             {"transform", options.tree.transform_alternative},
                             {"insertion", options.tree_insertion},
                             {"merging", options.tree_merging}};
  }
  // Names are any bytes.
  provenance.configuration = configuration.dump(-1, ' ', false, Json::error_handler_t::replace);
  provenance.seed = static_cast<std::int64_t>(options.seed);
  for (const MappedRun& run : result.runs) {
    RunRecord& record = provenance.runs.emplace_back(run);
    record.trajectory = Thinned(run.trajectory);
  }
  provenance.older = result.older;
  return provenance;
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

// Codes on vehicles are no landmarks.
void WarnOfMoving(const std::vector<MapperInput>& inputs,
                  const FrontEndOptions& options,
                  const Context& context) {
  for (const MapperInput& input : inputs) {
    for (const auto& [signature, count] : MovingSightings(input.run, options)) {
      context.Warn(
          fmt::format("run '{}': landmark '{}' moves while it is in view, as a code on a vehicle: "
                      "{} sightings are left out",
                      input.name,
                      InertLine(signature.text()),
                      count));
    }
  }
}

void WarnOfOdd(const MapperResult& result, const Context& context) {
  for (const MappedRun& run : result.runs) {
    for (const Stamp stamp : run.moved) {
      context.Warn(
          fmt::format("run '{}': after {} UTC the vehicle was moved and its odometry did not "
                      "see it: it was carried or towed, or the recorder paused",
                      run.name,
                      FormatUtc(stamp)));
    }
    if (run.anonymous_observations > 0) {
      context.Inform(fmt::format("run '{}': {} observations without a signature are left out",
                                 run.name,
                                 run.anonymous_observations));
    }
    if (run.duplicate_observations == 0) continue;
    context.Warn(fmt::format(
        "run '{}': {} observations of a signature at two places in one scan are left out",
        run.name,
        run.duplicate_observations));
  }
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

// What cannot be written is better known before the work than after it.
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
  const std::optional<VersionNumber> parent = ParentOf(version, versions);
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
  SHIFTMAP_RETURN_IF_ERROR(result.status());
  build.result = *std::move(result);
  HoldControlPoints(prior.edits, &build.result);
  build.dropped = std::move(runs.dropped);
  std::vector<RejectedRun>& rejected = build.result.rejected;
  rejected.insert(rejected.end(), runs.rejected.begin(), runs.rejected.end());
  WarnOfOdd(build.result, context);
  build.provenance = MakeProvenance(options, build, in_logs);
  build.commit_options = MakeCommitOptions(options, prior, build.result);
  SHIFTMAP_RETURN_IF_ERROR(AddObjections(options, context, &build));
  return build;
}

Status CommitArea(const AreaBuildOptions& options, const Context& context, AreaBuild* build) {
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

void WarnOfRuns(const AreaBuild& build, Context& context) {
  for (const std::string& line : WaitingLines(build.result)) context.Attend(line);
  for (const std::string& line : KeptLines(build.result)) context.Warn(line);
  for (const std::string& run : build.fallen_out) {
    context.Attend(fmt::format(
        "run '{}' is no longer in the map: its version is no prior; build its log again", run));
  }
  for (const std::string& line : build.objections) context.Attend(line);
  for (const std::string& line : build.at_two_places) context.Warn(line);
  for (const UnplacedRun& run : build.not_given) {
    context.Warn(fmt::format("run '{}' waits {}", run.name, WaitingReason(run)));
  }
  for (const std::string& line : LeftOutLines(build.result)) context.Warn(line);
}

}  // namespace shiftmap
