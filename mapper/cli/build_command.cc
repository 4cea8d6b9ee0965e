// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <charconv>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "mapper/cli/commands.h"
#include "mapper/mapper.h"
#include "mapper/selection/selector.h"
#include "mapstore/cli/store_access.h"
#include "mapstore/cli/version.h"
#include "mapstore/codec/run_log.h"
#include "mapstore/map_store.h"

namespace shiftmap {
namespace {

// Poses of a run that the store keeps for pictures.
constexpr std::size_t kStoredPoses = 2000;

struct BuildOptions {
  std::string store;
  std::string area;
  std::string selector = "viterbi";
  std::string engine = "graph";
  std::string prior = "published";
  bool no_publish = false;
  bool no_calibration = false;
  bool no_learned_rates = false;
  std::optional<std::string> trajectories;
  std::uint64_t seed = MapperOptions().seed;
  double leave_rate_per_s = ModeOptions().leave_rate_per_s;
  std::vector<std::string> logs;
};

// The version that a build starts from.
struct PriorMap {
  std::optional<VersionNumber> version;
  std::optional<MapContent> content;
  std::optional<LedgerPosition> ledger_position;
  std::set<std::string> run_hashes;  // Of the runs that are in it already.
};

// Chains are learned from what shifts reported on the line of the prior map. Reports about the logs
// of the build are left out: it sees the same visits itself, with all modes.
StatusOr<std::vector<EvidenceRow>> LoadLedger(const BuildOptions& options,
                                              const PriorMap& prior,
                                              const std::vector<MapperInput>& inputs,
                                              const Context& context) {
  if (!prior.version || options.no_learned_rates) return std::vector<EvidenceRow>();
  std::set<std::string> hashes;
  for (const MapperInput& input : inputs) hashes.insert(input.sha256);
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store,
                            OpenStore(options.store, MapStore::Access::kReadOnly, context));
  return store.Evidence(options.area, *prior.version, hashes);
}

std::vector<std::string> SelectorNames() {
  std::vector<std::string> names;
  for (const SelectorKind kind : AllSelectors()) names.push_back(SelectorName(kind));
  return names;
}

bool IsPriorName(const std::string& text) {
  if (text == "published" || text == "none") return true;
  VersionNumber::Value number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  return error == std::errc() && end == text.data() + text.size() && number > 0;
}

// Runs of a version and of those it was made from.
StatusOr<std::set<std::string>> RunHashes(MapStore& store,
                                          const std::string& area,
                                          VersionNumber version) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<VersionSummary> versions, store.Versions(area));
  std::set<std::string> hashes;
  std::optional<VersionNumber> at = version;
  while (at) {
    SHIFTMAP_ASSIGN_OR_RETURN(const Provenance provenance, store.LoadProvenance(area, *at));
    for (const RunRecord& run : provenance.runs) hashes.insert(run.sha256);
    std::optional<VersionNumber> parent;
    for (const VersionSummary& summary : versions) {
      if (summary.version == *at) parent = summary.parent;
    }
    at = parent;
  }
  return hashes;
}

StatusOr<PriorMap> LoadPrior(const BuildOptions& options, const Context& context) {
  PriorMap prior;
  std::error_code error;
  const bool exists = std::filesystem::exists(options.store, error);
  const bool needed = options.prior != "none" && options.prior != "published";
  if (!exists && !needed) return prior;
  // Opened even without a prior: what is no store is better known before the work than after it.
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store,
                            OpenStore(options.store, MapStore::Access::kReadOnly, context));
  if (options.prior == "none") return prior;
  if (options.prior == "published") {
    SHIFTMAP_ASSIGN_OR_RETURN(prior.version, store.PublishedVersion(options.area));
    if (!prior.version) return prior;
  } else {
    prior.version = VersionNumber(std::stoll(options.prior));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot snapshot, store.LoadAt(options.area, prior.version));
  prior.content = snapshot.content();
  prior.ledger_position = snapshot.ledger_position();
  SHIFTMAP_ASSIGN_OR_RETURN(prior.run_hashes, RunHashes(store, options.area, *prior.version));
  return prior;
}

struct LoadedRuns {
  std::vector<MapperInput> inputs;
  std::vector<RejectedRun> rejected;
};

StatusOr<LoadedRuns> LoadRuns(const BuildOptions& options,
                              const PriorMap& prior,
                              const Context& context) {
  LoadedRuns runs;
  std::set<std::string> seen = prior.run_hashes;
  for (const std::string& path : options.logs) {
    SHIFTMAP_ASSIGN_OR_RETURN(RunLog log, ReadRunLog(path));
    if (!log.truncation.empty()) {
      context.Warn(fmt::format("run log '{}': {}", path, log.truncation));
    }
    const std::string name = std::filesystem::path(path).stem().string();
    if (!seen.insert(log.sha256).second) {
      runs.rejected.push_back({name, "already in the map"});
      continue;
    }
    runs.inputs.push_back({name, log.sha256, std::move(log.run)});
  }
  if (runs.inputs.empty()) {
    return MakeStatus(
        StatusCode::kAlreadyExists, "area '{}': every run is already in the map", options.area);
  }
  return runs;
}

std::vector<StampedPose> Thinned(const std::vector<StampedPose>& trajectory) {
  const std::size_t step = trajectory.size() / kStoredPoses + 1;
  std::vector<StampedPose> thinned;
  for (std::size_t i = 0; i < trajectory.size(); i += step) thinned.push_back(trajectory[i]);
  return thinned;
}

Provenance MakeProvenance(const BuildOptions& options, const MapperResult& result) {
  Provenance provenance;
  provenance.tool = "shiftmap-mapper " + SoftwareVersion();
  provenance.configuration = Json{{"revision", SoftwareRevision()},
                                  {"selector", options.selector},
                                  {"engine", options.engine},
                                  {"prior", options.prior},
                                  {"calibrate", !options.no_calibration},
                                  {"leave_rate_per_s", options.leave_rate_per_s},
                                  {"learned_rates", !options.no_learned_rates}}
                                 .dump();
  provenance.seed = static_cast<std::int64_t>(options.seed);
  for (const MappedRun& run : result.runs) {
    provenance.runs.push_back(
        {run.name, run.sha256, run.vehicle, run.begin, run.end, Thinned(run.trajectory)});
  }
  return provenance;
}

Json RunJson(const MappedRun& run) {
  return {{"run", run.name},
          {"poses", run.poses},
          {"observations", run.observations},
          {"outliers", run.outliers},
          {"chi2", run.chi2},
          {"T_map_start", {run.T_map_start.x(), run.T_map_start.y(), run.T_map_start.yaw()}},
          {"odometry",
           {{"scale_v", run.odometry.scale_v},
            {"scale_omega", run.odometry.scale_omega},
            {"lag_s", run.odometry.lag_s}}},
          {"sensor",
           {{"bearing_offset_rad", run.sensor_bias[0]},
            {"range_curvature_per_rad2", run.sensor_bias[1]}}}};
}

// @param landmark  The group in the map.
Json ChainJson(const GroupChain& group, const LandmarkGroup& landmark) {
  Json chain = {{"signature", landmark.signature.text()},
                {"leave_rate_per_s", landmark.chain.leave_rate_per_s()},
                {"uniform", landmark.chain.uniform()},
                {"visits", group.chain.visits},
                {"learned", group.learned}};
  if (group.learned) {
    chain["interval_per_s"] = {group.chain.leave.low_per_s, group.chain.leave.high_per_s};
  }
  return chain;
}

Json ResultJson(const BuildOptions& options,
                const MapperResult& result,
                const std::optional<CommitResult>& commit) {
  Json document = {{"area", options.area}};
  if (commit) {
    document["version"] = commit->version.value();
    document["content_hash"] = commit->content_hash;
  } else {
    document["content_hash"] = ContentHash(result.content);
  }
  document["runs"] = Json::array();
  for (const MappedRun& run : result.runs) document["runs"].push_back(RunJson(run));
  document["rejected"] = Json::array();
  for (const RejectedRun& run : result.rejected) {
    document["rejected"].push_back({{"run", run.name}, {"reason", run.reason}});
  }
  std::size_t modes = 0;
  Json modes_per_group = Json::object();
  for (const LandmarkGroup& group : result.content.groups) {
    modes += group.modes.size();
    modes_per_group[group.signature.text()] = group.modes.size();
  }
  const OdometryCalibration& odometry = result.content.calibration.odometry;
  document["groups"] = result.content.groups.size();
  document["modes"] = modes;
  document["modes_per_group"] = modes_per_group;
  document["modes_created"] = result.modes_created;
  document["modes_merged"] = result.modes_merged;
  document["outer_iterations"] = result.outer_iterations;
  document["selector"] = options.selector;
  document["selection"] = {{"visits", result.selection.visits},
                           {"uncertain_visits", result.selection.uncertain_visits},
                           {"log_joint", result.selection.log_joint},
                           {"best_log_joint", result.selection.best_log_joint}};
  document["chains"] = Json::array();
  for (std::size_t i = 0; i < result.chains.size(); ++i) {
    document["chains"].push_back(ChainJson(result.chains[i], result.content.groups[i]));
  }
  document["odometry_calibration"] = {{"scale_v", odometry.scale_v},
                                      {"scale_omega", odometry.scale_omega},
                                      {"lag_s", odometry.lag_s},
                                      {"noise_v", odometry.noise_v},
                                      {"noise_omega", odometry.noise_omega}};
  return document;
}

std::string ResultText(const MapperResult& result, const std::optional<CommitResult>& commit) {
  std::string text =
      commit
          ? fmt::format("version {}, content {}\n", commit->version.value(), commit->content_hash)
          : std::string("nothing written\n");
  std::size_t modes = 0;
  for (const LandmarkGroup& group : result.content.groups) modes += group.modes.size();
  text += fmt::format("{} landmarks, {} modes, {} of them new\n",
                      result.content.groups.size(),
                      modes,
                      result.modes_created);
  for (const MappedRun& run : result.runs) {
    text += fmt::format("run {}: {} poses, {} observations, {} outliers\n",
                        run.name,
                        run.poses,
                        run.observations,
                        run.outliers);
  }
  return text;
}

Status WriteTrajectories(const std::string& folder, const MapperResult& result) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) return Unavailable("folder '{}': {}", folder, error.message());
  for (const MappedRun& run : result.runs) {
    SHIFTMAP_RETURN_IF_ERROR(WriteTum(run.trajectory, fmt::format("{}/{}.tum", folder, run.name)));
  }
  return OkStatus();
}

Status Build(const BuildOptions& options, Context& context) {
  const auto begin = std::chrono::steady_clock::now();
  SHIFTMAP_ASSIGN_OR_RETURN(const PriorMap prior, LoadPrior(options, context));
  SHIFTMAP_ASSIGN_OR_RETURN(LoadedRuns runs, LoadRuns(options, prior, context));

  MapperOptions mapper_options;
  mapper_options.seed = options.seed;
  mapper_options.calibrate = !options.no_calibration;
  mapper_options.modes.leave_rate_per_s = options.leave_rate_per_s;
  mapper_options.chains.learn = !options.no_learned_rates;
  SHIFTMAP_ASSIGN_OR_RETURN(mapper_options.chains.ledger,
                            LoadLedger(options, prior, runs.inputs, context));
  SHIFTMAP_ASSIGN_OR_RETURN(mapper_options.modes.selector.kind, ParseSelector(options.selector));
  mapper_options.modes.selector.seed = options.seed;
  const std::unique_ptr<Progress> progress = context.MakeProgress();
  SHIFTMAP_ASSIGN_OR_RETURN(
      MapperResult result,
      BuildMap(std::move(runs.inputs),
               prior.content,
               mapper_options,
               [&](const std::string& phase, double done) { progress->Update(phase, done); }));
  result.rejected.insert(result.rejected.end(), runs.rejected.begin(), runs.rejected.end());
  for (const RejectedRun& run : result.rejected) {
    context.Warn(fmt::format("run '{}' is left out: {}", run.name, run.reason));
  }

  std::optional<CommitResult> commit;
  if (!context.dry_run()) {
    if (options.trajectories)
      SHIFTMAP_RETURN_IF_ERROR(WriteTrajectories(*options.trajectories, result));
    SHIFTMAP_ASSIGN_OR_RETURN(
        MapStore store, OpenStore(options.store, MapStore::Access::kReadWriteCreate, context));
    CommitOptions commit_options;
    commit_options.parent = prior.version;
    commit_options.publish = !options.no_publish;
    commit_options.ledger_position = prior.ledger_position;
    SHIFTMAP_ASSIGN_OR_RETURN(
        commit,
        store.Commit(
            options.area, result.content, MakeProvenance(options, result), commit_options));
  }
  Json document = ResultJson(options, result, commit);
  document["wall_s"] =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  context.Report(document, ResultText(result, commit));
  return OkStatus();
}

}  // namespace

void AddBuildCommand(Application* application) {
  auto options = std::make_shared<BuildOptions>();
  application
      ->AddCommand("build",
                   "Build a map version from run logs",
                   [options](Context& context) { return Build(*options, context); })
      .Option("--store", &options->store, "Map store; made if there is none")
      .Required()
      .Option("--area", &options->area, "Area to make a version of")
      .Required()
      .Option("--selector", &options->selector, "How the mode of a visit is chosen")
      .OneOf(SelectorNames())
      .Option("--engine", &options->engine, "How the map is estimated")
      .OneOf({"graph"})
      .Option("--prior", &options->prior, "Map to start from: published, none, or a version number")
      .Flag("--no-publish", &options->no_publish, "Add the version, but publish it later")
      .Flag("--no-calibration",
            &options->no_calibration,
            "Take odometry and sensors at their default calibration")
      .Flag("--no-learned-rates",
            &options->no_learned_rates,
            "Leave the rates of known landmarks' mode chains as they are")
      .Option("--trajectories", &options->trajectories, "Folder for one <run>.tum per run")
      .Option(
          "--seed", &options->seed, "Seed of the noise estimate's samples and of --selector mcts")
      .Option("--leave-rate-per-s",
              &options->leave_rate_per_s,
              "Rate at which landmarks leave a mode, before there is evidence")
      .InRange(0.0, 1e3)
      .Option("RUN.mcap", &options->logs, "Run logs of the area, of any days and vehicles")
      .Required()
      .Check([options] {
        if (IsPriorName(options->prior)) return std::string();
        return fmt::format("--prior '{}', expected published, none or a version number",
                           options->prior);
      })
      .Writes();
}

}  // namespace shiftmap
