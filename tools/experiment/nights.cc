// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/nights.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <span>
#include <sstream>
#include <utility>

#include "localizer/cli/commands.h"
#include "mapper/cli/commands.h"
#include "mapstore/codec/run_log.h"
#include "mapstore/codec/shift_report.h"
#include "mapstore/core/folder.h"
#include "mapstore/map_store.h"
#include "tools/eval/map_error.h"
#include "tools/eval/trajectory_error.h"
#include "tools/inspect/inspect_commands.h"
#include "tools/sim/world_files.h"

namespace shiftmap {
namespace {

// A mode this near to a place stands for it. [m]
constexpr double kSamePlaceM = 0.5;
constexpr double kWrongModeM = 0.3;

struct CommandOutput {
  ExitCode code = ExitCode::kDone;
  Json document;
};

// Runs a command in this process, with --json.
// @param allowed  Exit codes.
StatusOr<CommandOutput> RunInProcess(void (*add)(Application*),
                                     const std::vector<std::string>& words,
                                     const std::vector<ExitCode>& allowed) {
  Application application("shiftmap", "");
  add(&application);
  std::ostringstream out;
  std::ostringstream err;
  std::vector<std::string> arguments = words;
  arguments.push_back("--json");
  const ExitCode code = application.Run(arguments, &out, &err);
  if (std::find(allowed.begin(), allowed.end(), code) != allowed.end()) {
    return CommandOutput{code, Json::parse(out.str())};
  }
  return Internal("{}: exit code {}: {}", fmt::join(words, " "), static_cast<int>(code), err.str());
}

// The map of a version, in the frame of the truth.
struct TruthMap {
  MapSnapshot map;
  Se2 T_truth_map;
};

// A landmark since the vehicle with the fault visited it.
struct Recovery {
  int state = -1;          // The true one, when others saw it.
  std::set<int> vehicles;  // That saw it in this state.
};

class Site {
 public:
  Site(const NightsOptions& options, NightsWorld world, std::string folder, std::string area)
      : options_(options),
        world_(std::move(world)),
        folder_(std::move(folder)),
        area_(std::move(area)) {}

  const NightsOptions& options() const { return options_; }

  // Makes the folders.
  Status Start() const;

  // The shifts of a day.
  Status DriveDay(int night, NightResult* result);

  // What the night after it made of the map.
  Status CountNight(int night, NightResult* result);

  // After the first night: makes control points of the map, by `shiftmap-inspect edit`.
  Status Survey() const;

  std::vector<Removal> Removals() const;

 private:
  std::string store() const { return SiteStore(folder_); }
  std::string logs() const { return folder_ + "/logs/" + area_; }
  std::string Stem(int index) const { return fmt::format("{}/{:04}", logs(), index); }

  // Whether it is a shift with the fault.
  bool IsFaulty(int index) const {
    const int night = index / options_.vehicles + 1;
    return index % options_.vehicles == 0 && night >= options_.fault_night &&
           night < options_.fault_night + options_.fault_nights;
  }
  VehicleFault FaultOf(int index) const {
    return IsFaulty(index) ? options_.fault : VehicleFault::kNone;
  }
  const SimulatedRun& run(int index) const {
    return world_.world.runs[static_cast<std::size_t>(index)];
  }

  StatusOr<std::optional<TruthMap>> LoadMap(int run, std::optional<Stamp> at) const;
  void CountStates(const TruthMap& map, int index, NightResult* result);
  Status DriveShift(int index, NightResult* result);
  StatusOr<std::optional<CommandOutput>> Localize(int index) const;
  Status HandInFalseReports(int index, const ShiftReport& report) const;
  Status CountShift(int index,
                    const TruthMap& map,
                    const CommandOutput& output,
                    const ShiftReport& report,
                    NightResult* result);
  Status CountRecovery(int index, const ShiftReport& report, NightResult* result);
  void CountModes(const TruthMap& map, NightResult* result) const;
  void CountFrame(const Se2& T_truth_map, NightResult* result);
  bool NeverMoves(std::size_t group) const;
  std::size_t TruthIndex(const Signature& signature) const;
  int TrueState(const TruthMap& map, std::size_t group, const LandmarkGroup& known, int run) const;

  NightsOptions options_;
  NightsWorld world_;
  std::string folder_;
  std::string area_;
  std::map<std::string, int> waiting_since_;  // Night, by hash.
  std::optional<Se2> first_frame_;            // T_truth_map of the first map.
  std::map<std::size_t, int> absent_since_;   // Run, by group that was removed.
  std::map<Signature, Recovery> recoveries_;  // Of what the vehicle with the fault visited.
  double square_error_ = 0.0;                 // Of the day's poses. [m²]
  int poses_ = 0;
};

// Where landmarks have stood up to a run, that included.
std::vector<TruePlace> PlacesUntil(const SimulatedWorld& world, int run) {
  std::vector<TruePlace> places;
  for (std::size_t g = 0; g < world.groups.size(); ++g) {
    const SimulatedGroup& group = world.groups[g];
    for (std::size_t mode = 0; mode < group.modes.size(); ++mode) {
      const bool stood = std::any_of(
          world.runs.begin(), world.runs.begin() + run + 1, [&](const SimulatedRun& of) {
            return of.active_mode[g] == ModeNumber(static_cast<std::int64_t>(mode) + 1);
          });
      if (stood) places.push_back({group.signature, group.modes[mode]});
    }
  }
  return places;
}

// The published map, nothing before the first night.
StatusOr<std::optional<TruthMap>> Site::LoadMap(int run, std::optional<Stamp> at) const {
  std::error_code error;
  if (!std::filesystem::exists(store(), error)) return std::optional<TruthMap>();
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore maps, MapStore::Open(store(), MapStore::Access::kReadOnly));
  SHIFTMAP_ASSIGN_OR_RETURN(const auto published, maps.PublishedVersion(area_));
  if (!published) return std::optional<TruthMap>();
  SHIFTMAP_ASSIGN_OR_RETURN(MapSnapshot map, maps.LoadAt(area_, published, at));
  SHIFTMAP_ASSIGN_OR_RETURN(
      const MapError fit,
      EvaluateMap(map.groups(), PlacesUntil(world_.world, run), /*align=*/true));
  return std::optional(TruthMap{std::move(map), fit.T_truth_map});
}

// The index of a landmark in the world, which has all that the map has.
std::size_t Site::TruthIndex(const Signature& signature) const {
  const std::vector<SimulatedGroup>& groups = world_.world.groups;
  const auto found = std::find_if(groups.begin(), groups.end(), [&](const SimulatedGroup& group) {
    return group.signature == signature;
  });
  return static_cast<std::size_t>(found - groups.begin());
}

// The state of the map that holds in a run, -1 if the map does not have it.
int Site::TrueState(const TruthMap& map,
                    std::size_t group,
                    const LandmarkGroup& known,
                    int index) const {
  const ModeNumber mode = run(index).active_mode[group];
  if (mode == kAbsent) return 0;
  const Eigen::Vector2d place =
      world_.world.groups[group].modes[static_cast<std::size_t>(mode.value()) - 1];
  int nearest = -1;
  double distance = kSamePlaceM;
  for (std::size_t i = 0; i < known.modes.size(); ++i) {
    const double of_mode = (map.T_truth_map * known.modes[i].p_map_landmark - place).norm();
    if (of_mode >= distance) continue;
    distance = of_mode;
    nearest = static_cast<int>(i) + 1;
  }
  return nearest;
}

// @param poses  In the frame of the truth.
Status CountStart(const std::vector<StampedPose>& poses,
                  const std::vector<StampedPose>& truth,
                  NightResult* result) {
  constexpr double kWrongStartM = 1.0;
  SHIFTMAP_ASSIGN_OR_RETURN(const TrajectoryError first,
                            EvaluateTrajectory(std::span(poses).first(1), truth, {}));
  if (first.position_max_m > kWrongStartM) ++result->wrong_starts;
  return OkStatus();
}

void Site::CountStates(const TruthMap& map, int index, NightResult* result) {
  constexpr double kSure = 20.0 / 21.0;
  for (std::size_t g = 0; g < world_.world.groups.size(); ++g) {
    const int known = map.map.GroupIndex(world_.world.groups[g].signature);
    if (known < 0) continue;
    const LandmarkGroup& group = map.map.groups()[static_cast<std::size_t>(known)];
    const int state = TrueState(map, g, group, index);
    if (state < 0) {
      ++result->new_places;
      continue;
    }
    const double p = group.probabilities(state);
    Eigen::Index likeliest = 0;
    const double p_most = group.probabilities.maxCoeff(&likeliest);
    ++result->states;
    result->p_true_sum += p;
    result->log_p_true_sum += std::log(std::max(p, 1e-300));
    if (likeliest != state) ++result->wrong_likeliest;
    if (p_most > kSure) ++result->sure;
    if (likeliest != state && p_most > kSure) ++result->wrong_sure;
    const std::optional<int>& removed = world_.removed[g];
    if (removed && *removed <= index && state == 0 && p > 0.5) absent_since_.emplace(g, index);
  }
}

// Localizes the log of a shift; nothing if no start was found.
StatusOr<std::optional<CommandOutput>> Site::Localize(int index) const {
  std::vector<std::string> words = {"run",
                                    "--store",
                                    store(),
                                    "--area",
                                    area_,
                                    "--report",
                                    Stem(index) + ".report",
                                    "--trajectory",
                                    Stem(index) + ".tum",
                                    Stem(index) + ".mcap"};
  if (options_.return_at_once && !IsOfReports(FaultOf(index))) words.emplace_back("--return");
  SHIFTMAP_ASSIGN_OR_RETURN(
      CommandOutput output,
      RunInProcess(AddRunCommand, words, {ExitCode::kDone, ExitCode::kNotLocalized}));
  if (output.code == ExitCode::kNotLocalized) return std::optional<CommandOutput>();
  return std::optional(std::move(output));
}

// Of who reports falsely there is no log.
Status Site::HandInFalseReports(int index, const ShiftReport& report) const {
  std::filesystem::remove(Stem(index) + ".mcap");
  std::filesystem::remove(Stem(index) + ".report");
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore maps, MapStore::Open(store(), MapStore::Access::kReadWrite));
  for (const ShiftReport& falsified : WithFault(report, options_.fault)) {
    SHIFTMAP_RETURN_IF_ERROR(maps.Return(falsified).status());
  }
  return OkStatus();
}

Status Site::CountShift(int index,
                        const TruthMap& map,
                        const CommandOutput& output,
                        const ShiftReport& report,
                        NightResult* result) {
  const SimulatedRun& simulated = run(index);
  ++result->localized;
  result->start_s_sum += output.document["states"]["INITIALIZING"].get<double>();
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<StampedPose> poses, ReadTum(Stem(index) + ".tum"));
  for (StampedPose& pose : poses) pose.T_map_vehicle = map.T_truth_map * pose.T_map_vehicle;
  SHIFTMAP_RETURN_IF_ERROR(CountStart(poses, simulated.truth, result));
  SHIFTMAP_ASSIGN_OR_RETURN(const TrajectoryError error,
                            EvaluateTrajectory(poses, simulated.truth, {}));
  square_error_ += error.matched * error.position_rmse_m * error.position_rmse_m;
  poses_ += error.matched;
  for (const Decision& decision : report.decisions) {
    const LandmarkGroup& known =
        map.map.groups()[static_cast<std::size_t>(map.map.GroupIndex(decision.signature))];
    // One that stands at a new place is at none of the modes.
    const int state = std::max(0, TrueState(map, TruthIndex(decision.signature), known, index));
    ++result->decisions;
    if (known.StateOf(decision.mode) != state) ++result->wrong_decisions;
  }
  return OkStatus();
}

void Count(const LandmarkGroup& group, int state, RecoveryCount* count) {
  constexpr double kDoubtful = 0.95;
  Eigen::Index likeliest = 0;
  group.probabilities.maxCoeff(&likeliest);
  const double p_true = group.probabilities(state);
  ++count->states;
  if (likeliest != state) ++count->wrong_likeliest;
  if (p_true < kDoubtful) ++count->doubtful;
  count->p_true_min = std::min(count->p_true_min, p_true);
}

// What the store makes of the landmarks that a shift without a fault visited.
Status Site::CountRecovery(int index, const ShiftReport& report, NightResult* result) {
  constexpr int kMinSeen = 3;  // Fewer are a passing view.
  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<TruthMap> map, LoadMap(index, report.end));
  for (const VisitEvidence& visit : report.evidence) {
    const auto recovery = recoveries_.find(visit.signature);
    const int known = map->map.GroupIndex(visit.signature);
    if (recovery == recoveries_.end() || known < 0) continue;
    const LandmarkGroup& group = map->map.groups()[static_cast<std::size_t>(known)];
    const int state = TrueState(*map, TruthIndex(visit.signature), group, index);
    if (state < 0 || (state > 0 && visit.observations < kMinSeen)) continue;
    auto& [before, vehicles] = recovery->second;
    if (before != state) vehicles.clear();
    before = state;
    vehicles.insert(index % options_.vehicles);
    Count(group, state, vehicles.size() == 1 ? &result->after_one : &result->after_two);
  }
  return OkStatus();
}

Status Site::DriveShift(int index, NightResult* result) {
  const VehicleFault fault = FaultOf(index);
  Run log = WithFault(run(index).run, fault);
  log.info.area = area_;
  SHIFTMAP_RETURN_IF_ERROR(WriteRunLog(log, Stem(index) + ".mcap"));
  const Stamp begin = log.odometry.front().stamp;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<TruthMap> map, LoadMap(index, begin));
  if (!map) return OkStatus();
  if (!IsFaulty(index)) {
    ++result->shifts;
    CountStates(*map, index, result);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<CommandOutput> output, Localize(index));
  if (!output) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(const ShiftReport report, ReadShiftReport(Stem(index) + ".report"));
  if (IsOfReports(fault)) SHIFTMAP_RETURN_IF_ERROR(HandInFalseReports(index, report));
  if (IsFaulty(index)) {
    for (const VisitEvidence& visit : report.evidence) recoveries_[visit.signature] = {};
    return OkStatus();
  }
  SHIFTMAP_RETURN_IF_ERROR(CountShift(index, *map, *output, report, result));
  return options_.return_at_once ? CountRecovery(index, report, result) : OkStatus();
}

// Errors of the modes against the nearest place of their landmark.
void Site::CountModes(const TruthMap& map, NightResult* result) const {
  double squares = 0.0;
  for (const LandmarkGroup& group : map.map.groups()) {
    const SimulatedGroup& truth = world_.world.groups[TruthIndex(group.signature)];
    for (const Mode& mode : group.modes) {
      double distance = std::numeric_limits<double>::infinity();
      for (const Eigen::Vector2d& place : truth.modes) {
        distance = std::min(distance, (map.T_truth_map * mode.p_map_landmark - place).norm());
      }
      ++result->modes;
      if (distance >= kWrongModeM) {
        ++result->wrong_modes;
      } else {
        squares += distance * distance;
      }
    }
  }
  result->map_rmse_m = std::sqrt(squares / std::max(1, result->modes - result->wrong_modes));
}

// How far the frame has moved since the first map, as the fit to the truth has it.
void Site::CountFrame(const Se2& T_truth_map, NightResult* result) {
  if (!first_frame_) first_frame_ = T_truth_map;
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  double places = 0.0;
  for (const SimulatedGroup& group : world_.world.groups) {
    for (const Eigen::Vector2d& place : group.modes) {
      centre += place;
      places += 1.0;
    }
  }
  centre /= std::max(1.0, places);
  const Se2 moved = T_truth_map * first_frame_->Inverse();
  result->frame_shift_m = (moved * centre - centre).norm();
  result->frame_turn_rad = moved.yaw();
}

Status Site::CountNight(int night, NightResult* result) {
  const int last = night * options_.vehicles - 1;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<TruthMap> map, LoadMap(last, std::nullopt));
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore maps, MapStore::Open(store(), MapStore::Access::kReadOnly));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<UnplacedRun> waiting, maps.WaitingRuns(area_));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<Exclusion> exclusions, maps.Exclusions(area_));
  result->waiting = static_cast<int>(waiting.size());
  result->held = static_cast<int>(exclusions.size());
  result->unmapped = last + 1;
  if (map) {
    CountModes(*map, result);
    CountFrame(map->T_truth_map, result);
    SHIFTMAP_ASSIGN_OR_RETURN(const std::set<std::string> mapped,
                              maps.RunIdentities(area_, map->map.version()));
    result->unmapped -= static_cast<int>(mapped.size());
  }
  for (const UnplacedRun& waits : waiting) {
    const int since = waiting_since_.emplace(waits.sha256, night).first->second;
    result->waited_nights = std::max(result->waited_nights, night - since + 1);
  }
  return OkStatus();
}

bool Site::NeverMoves(std::size_t group) const {
  const ModeNumber first = run(0).active_mode[group];
  return first != kAbsent &&
         std::all_of(world_.world.runs.begin(), world_.world.runs.end(), [&](const auto& of) {
           return of.active_mode[group] == first;
         });
}

Status Site::Survey() const {
  constexpr const char* kSurveySdM = "0.01";
  const int last = options_.vehicles - 1;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<TruthMap> map, LoadMap(last, std::nullopt));
  if (!map) return OkStatus();
  int left = options_.control_points;
  for (std::size_t g = 0; g < world_.world.groups.size() && left > 0; ++g) {
    const SimulatedGroup& group = world_.world.groups[g];
    if (!NeverMoves(g) || map->map.GroupIndex(group.signature) < 0) continue;
    const ModeNumber stands = run(0).active_mode[g];
    const Eigen::Vector2d place =
        map->T_truth_map.Inverse() * group.modes[static_cast<std::size_t>(stands.value()) - 1];
    SHIFTMAP_RETURN_IF_ERROR(RunInProcess(AddEditCommands,
                                          {"edit",
                                           "control",
                                           group.signature.text(),
                                           fmt::format("{:.4f},{:.4f}", place.x(), place.y()),
                                           "--sd",
                                           kSurveySdM,
                                           "--reason",
                                           "survey",
                                           "--store",
                                           store(),
                                           "--area",
                                           area_},
                                          {ExitCode::kDone})
                                 .status());
    --left;
  }
  return OkStatus();
}

Status Site::Start() const {
  SHIFTMAP_RETURN_IF_ERROR(MakeFolder(logs()));
  return WriteWorld(world_.world, fmt::format("{}/world/{}", folder_, area_)).status();
}

Status Site::DriveDay(int night, NightResult* result) {
  square_error_ = 0.0;
  poses_ = 0;
  for (int shift = 0; shift < options_.vehicles; ++shift) {
    SHIFTMAP_RETURN_IF_ERROR(DriveShift((night - 1) * options_.vehicles + shift, result));
  }
  result->rmse_m = std::sqrt(square_error_ / poses_);
  return OkStatus();
}

std::vector<Removal> Site::Removals() const {
  std::vector<Removal> removals;
  for (std::size_t g = 0; g < world_.removed.size(); ++g) {
    if (!world_.removed[g]) continue;
    const auto found = absent_since_.find(g);
    const double runs = found == absent_since_.end()
                            ? std::numeric_limits<double>::quiet_NaN()
                            : static_cast<double>(found->second - *world_.removed[g]);
    removals.push_back(
        {world_.world.groups[g].signature, *world_.removed[g], runs / options_.vehicles});
  }
  return removals;
}

// One night over all sites; `results` are those of the night.
Status RunNight(const std::string& folder,
                const std::vector<std::string>& night_words,
                const std::vector<NightResult*>& results) {
  std::vector<std::string> words = {
      "nightly", "--store", SiteStore(folder), "--logs", folder + "/logs", "--min-age-s", "0"};
  words.insert(words.end(), night_words.begin(), night_words.end());
  const auto begin = std::chrono::steady_clock::now();
  SHIFTMAP_ASSIGN_OR_RETURN(
      const CommandOutput output,
      RunInProcess(AddNightlyCommand,
                   words,
                   {ExitCode::kDone, ExitCode::kAttention, ExitCode::kNothingToDo}));
  const double wall_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  constexpr double kMib = 1024.0 * 1024.0;
  const double mib = static_cast<double>(std::filesystem::file_size(SiteStore(folder))) / kMib;
  for (std::size_t i = 0; i < results.size(); ++i) {
    results[i]->night_s = wall_s;
    results[i]->store_mib = mib;
    if (!output.document.contains("areas") || i >= output.document["areas"].size()) continue;
    results[i]->published = output.document["areas"][i]["published"].get<bool>();
  }
  return OkStatus();
}

StatusOr<std::vector<NightsResult>> DriveSites(
    std::vector<Site>* sites,
    const std::string& folder,
    const std::vector<std::string>& night_words,
    const std::function<void(const std::vector<NightsResult>&)>& progress) {
  std::vector<NightsResult> all(sites->size());
  for (const Site& site : *sites) SHIFTMAP_RETURN_IF_ERROR(site.Start());
  const NightsOptions options = sites->front().options();
  for (int night = 1; night <= options.nights; ++night) {
    std::vector<NightResult*> results;
    for (std::size_t i = 0; i < sites->size(); ++i) {
      results.push_back(&all[i].nights.emplace_back());
      results.back()->night = night;
      SHIFTMAP_RETURN_IF_ERROR((*sites)[i].DriveDay(night, results.back()));
    }
    if (night % options.nights_per_build == 0 || night == options.nights) {
      SHIFTMAP_RETURN_IF_ERROR(RunNight(folder, night_words, results));
      for (std::size_t i = 0; i < sites->size(); ++i) {
        SHIFTMAP_RETURN_IF_ERROR((*sites)[i].CountNight(night, results[i]));
        if (night == 1) SHIFTMAP_RETURN_IF_ERROR((*sites)[i].Survey());
      }
    }
    progress(all);
  }
  for (std::size_t i = 0; i < sites->size(); ++i) all[i].removals = (*sites)[i].Removals();
  return all;
}

Status CheckNew(const std::string& folder) {
  std::error_code error;
  if (!std::filesystem::exists(folder, error)) return OkStatus();
  return FailedPrecondition("folder '{}': is there already", folder);
}

}  // namespace

std::string SiteStore(const std::string& folder) { return folder + "/maps.db"; }

StatusOr<NightsResult> DriveNights(const NightsOptions& options,
                                   const std::string& folder,
                                   const std::vector<std::string>& night_words,
                                   const std::function<void(const NightResult&)>& progress) {
  SHIFTMAP_RETURN_IF_ERROR(CheckNew(folder));
  SHIFTMAP_ASSIGN_OR_RETURN(NightsWorld world, DrawNights(options));
  std::vector<Site> sites;
  sites.emplace_back(options, std::move(world), folder, kSiteArea);
  SHIFTMAP_ASSIGN_OR_RETURN(
      std::vector<NightsResult> results,
      DriveSites(&sites, folder, night_words, [&](const std::vector<NightsResult>& all) {
        progress(all.front().nights.back());
      }));
  return std::move(results.front());
}

StatusOr<std::vector<NightsResult>> DriveFleet(
    const std::vector<NightsOptions>& options,
    const std::string& folder,
    const std::vector<std::string>& night_words,
    const std::function<void(const std::vector<NightsResult>&)>& progress) {
  SHIFTMAP_RETURN_IF_ERROR(CheckNew(folder));
  std::vector<Site> sites;
  for (const NightsOptions& of_site : options) {
    SHIFTMAP_ASSIGN_OR_RETURN(NightsWorld world, DrawNights(of_site));
    sites.emplace_back(of_site, std::move(world), folder, fmt::format("area-{:02}", sites.size()));
  }
  return DriveSites(&sites, folder, night_words, progress);
}

}  // namespace shiftmap
