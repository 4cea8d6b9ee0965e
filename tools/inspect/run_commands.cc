// SPDX-License-Identifier: Apache-2.0
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "mapstore/cli/aligned_table.h"
#include "mapstore/cli/store_access.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/core/nearest_name.h"
#include "tools/inspect/inspect_commands.h"
#include "tools/inspect/store_arguments.h"

namespace shiftmap {
namespace {

constexpr char kList[] = "list";
constexpr char kExclude[] = "exclude";
constexpr char kInclude[] = "include";
constexpr char kHold[] = "hold";

struct RunsArguments {
  std::string action = kList;
  StoreArguments store;
  std::vector<std::string> runs;
  std::string vehicle;
  std::optional<double> since_s;
  std::string reason;
  bool all = false;
};

std::string StateText(const Exclusion& exclusion) { return exclusion.held ? "held" : "excluded"; }

Json ExclusionJson(const Exclusion& exclusion) {
  Json json = {{"reason", exclusion.reason}, {"state", StateText(exclusion)}};
  if (exclusion.vehicle.empty()) {
    json["run"] = exclusion.run;
  } else {
    json["vehicle"] = exclusion.vehicle;
    json["since_s"] = ToSecondsSinceEpoch(exclusion.since);
  }
  return json;
}

// What an operator took out, runs and vehicles.
std::string ExclusionsText(const std::vector<Exclusion>& exclusions, const TextStyle& style) {
  if (exclusions.empty()) return "";
  AlignedTable table({"state", "what", "reason", "since", "decided"});
  for (const Exclusion& exclusion : exclusions) {
    const bool run = exclusion.vehicle.empty();
    table.AddRow({StateText(exclusion),
                  run ? "run " + exclusion.run : "vehicle " + exclusion.vehicle,
                  exclusion.reason,
                  run ? "" : TimeText(exclusion.since),
                  TimeText(exclusion.excluded)});
  }
  return "\n" + table.ToString(style);
}

// Runs that a build was given and could not place.
std::string WaitingText(const std::vector<UnplacedRun>& waiting, const TextStyle& style) {
  if (waiting.empty()) return "";
  AlignedTable table({"waits_for_a_build", "since", "sha256"});
  for (const UnplacedRun& run : waiting) {
    table.AddRow({run.name, TimeText(run.since), ShortHash(run.sha256)});
  }
  return "\n" + table.ToString(style) +
         "Each may lie at several places in the map. A build with its log and with a run past the "
         "landmarks in doubt decides.\n";
}

Json WaitingJson(const std::vector<UnplacedRun>& waiting) {
  Json list = Json::array();
  for (const UnplacedRun& run : waiting) {
    list.push_back(
        {{"run", run.name}, {"sha256", run.sha256}, {"since_s", ToSecondsSinceEpoch(run.since)}});
  }
  return list;
}

Status List(const RunsArguments& all_arguments, Context& context) {
  const StoreArguments& arguments = all_arguments.store;
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<Exclusion> exclusions,
                            store.Exclusions(arguments.area));
  SHIFTMAP_ASSIGN_OR_RETURN(std::optional<VersionNumber> version,
                            store.PublishedVersion(arguments.area));
  if (arguments.version) version = VersionNumber(*arguments.version);
  Provenance provenance;
  std::vector<LineRun> runs;
  if (version) {
    SHIFTMAP_ASSIGN_OR_RETURN(provenance, store.LoadProvenance(arguments.area, *version));
    for (const RunRecord& run : provenance.runs) runs.push_back({run, *version, {}});
  }
  if (version && all_arguments.all) {
    SHIFTMAP_ASSIGN_OR_RETURN(runs, store.LineRuns(arguments.area, *version));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<UnplacedRun> waiting,
                            store.WaitingRuns(arguments.area));
  Json list = Json::array();
  AlignedTable table({"run", "state", "vehicle", "begin", "version", "sha256", "duration_s"});
  for (const auto& [run, mapped_by, committed] : runs) {
    const Exclusion* const exclusion = FindExclusion(exclusions, run);
    const std::string state = exclusion == nullptr ? "" : StateText(*exclusion);
    list.push_back({{"run", run.name},
                    {"vehicle", run.vehicle},
                    {"sha256", run.sha256},
                    {"begin_s", ToSecondsSinceEpoch(run.begin)},
                    {"end_s", ToSecondsSinceEpoch(run.end)},
                    {"version", mapped_by.value()},
                    {"state", state.empty() ? Json(nullptr) : Json(state)}});
    table.AddRow(
        {run.name,
         state.empty() ? "" : fmt::format("{}: {}", state, exclusion->reason),
         run.vehicle,
         TimeText(run.begin),
         fmt::format("{}", mapped_by.value()),
         ShortHash(run.sha256),
         fmt::format("{:.1f}", ToSecondsSinceEpoch(run.end) - ToSecondsSinceEpoch(run.begin))},
        state.empty() ? Emphasis::kNone : Emphasis::kFaint);
  }
  Json taken_out = Json::array();
  for (const Exclusion& exclusion : exclusions) taken_out.push_back(ExclusionJson(exclusion));
  const Json document = {{"area", arguments.area},
                         {"version", version ? Json(version->value()) : Json(nullptr)},
                         {"tool", provenance.tool},
                         {"seed", provenance.seed},
                         {"runs", list},
                         {"exclusions", taken_out},
                         {"waiting", WaitingJson(waiting)}};
  context.Report(document,
                 table.ToString(context.style(), "no runs") +
                     ExclusionsText(exclusions, context.style()) +
                     WaitingText(waiting, context.style()));
  return OkStatus();
}

// One per run, or the vehicle's.
std::vector<Exclusion> Named(const RunsArguments& arguments) {
  const bool held = arguments.action == kHold;
  std::vector<Exclusion> exclusions;
  for (const std::string& run : arguments.runs) {
    exclusions.push_back({run, "", {}, arguments.reason, held});
  }
  if (!arguments.vehicle.empty()) {
    exclusions.push_back({"",
                          arguments.vehicle,
                          StampFromSeconds(arguments.since_s.value_or(0.0)),
                          arguments.reason,
                          held});
  }
  return exclusions;
}

// What the published version still rests on.
Status WarnOfPublished(const std::string& area, MapStore* store, const Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<VersionNumber> published,
                            store->PublishedVersion(area));
  if (!published) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<std::string> runs,
                            store->ExcludedRunsOf(area, *published));
  if (runs.empty()) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(
      const std::string next,
      NextBuildText(area, "the next build goes on from the newest ancestor without it", store));
  for (const std::string& run : runs) {
    context.Warn(fmt::format(
        "version {} is made from run '{}', which is excluded: {}", published->value(), run, next));
  }
  return OkStatus();
}

// A name with a slip of the pen takes nothing out. One of a vehicle that is still to come is no
// error.
Status WarnOfUnknownVehicle(const RunsArguments& arguments,
                            MapStore* store,
                            const Context& context) {
  const std::string& area = arguments.store.area;
  std::set<std::string> known;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<ReportSummary> reports, store->Reports(area));
  for (const ReportSummary& report : reports) known.insert(report.vehicle);
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<VersionSummary> versions, store->Versions(area));
  std::set<VersionNumber> parents;
  for (const VersionSummary& version : versions) {
    if (version.parent) parents.insert(*version.parent);
  }
  for (const VersionSummary& version : versions) {
    if (parents.contains(version.version)) continue;  // Its line has it.
    SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<LineRun> runs,
                              store->LineRuns(area, version.version));
    for (const LineRun& line : runs) known.insert(line.run.vehicle);
  }
  if (known.contains(arguments.vehicle)) return OkStatus();
  context.Warn(fmt::format("area '{}' has no run of a vehicle '{}' so far{}",
                           area,
                           InertLine(arguments.vehicle),
                           DidYouMean(arguments.vehicle, {known.begin(), known.end()})));
  return OkStatus();
}

Status Change(const RunsArguments& arguments, Context& context) {
  const bool include = arguments.action == kInclude;
  const auto access =
      context.dry_run() ? MapStore::Access::kReadOnly : MapStore::Access::kReadWrite;
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments.store.store, access, context));
  const std::string& area = arguments.store.area;
  Json list = Json::array();
  std::string text;
  const std::vector<Exclusion> named = Named(arguments);
  SHIFTMAP_RETURN_IF_ERROR(include ? store.IncludeAll(area, named, context.dry_run())
                                   : store.ExcludeAll(area, named, context.dry_run()));
  for (const Exclusion& exclusion : named) {
    list.push_back(ExclusionJson(exclusion));
    if (include) list.back()["state"] = "included";
    const bool run = exclusion.vehicle.empty();
    text += fmt::format("{} {}: {}{}\n",
                        run ? "run" : "vehicle",
                        InertLine(run ? exclusion.run : exclusion.vehicle),
                        context.dry_run() ? "would be " : "",
                        include ? "included again" : StateText(exclusion));
  }
  SHIFTMAP_RETURN_IF_ERROR(WarnOfPublished(area, &store, context));
  if (!include && !arguments.vehicle.empty()) {
    SHIFTMAP_RETURN_IF_ERROR(WarnOfUnknownVehicle(arguments, &store, context));
  }
  context.Report({{"area", area}, {"changed", list}}, text);
  return OkStatus();
}

std::string Misused(const RunsArguments& arguments) {
  const bool named = !arguments.runs.empty() || !arguments.vehicle.empty();
  if (arguments.action == kList) {
    const bool idle = named || !arguments.reason.empty() || arguments.since_s;
    return idle ? "list takes no runs, --vehicle, --since or --reason" : "";
  }
  if (!named) return "expected runs, or --vehicle";
  if (arguments.store.version || arguments.all) return "--version and --all are for list";
  if (arguments.since_s && arguments.vehicle.empty()) return "--since is for --vehicle";
  if (arguments.since_s && arguments.action == kInclude) {
    return "--since is to exclude or hold: include takes back all that was taken out of a vehicle";
  }
  const bool needs_reason = arguments.action != kInclude;
  return needs_reason && arguments.reason.empty() ? "expected --reason" : "";
}

}  // namespace

void AddRunCommands(Application* application) {
  auto arguments = std::make_shared<RunsArguments>();
  Command& command = application->AddCommand(
      "runs",
      "List the runs of a map version, or take runs out of an area's memory and back: excluded, "
      "they are as if they had never come; held, they count for nothing until somebody decides",
      [arguments](Context& context) {
        return arguments->action == kList ? List(*arguments, context) : Change(*arguments, context);
      });
  AddStoreOptions(&arguments->store, &command);
  command.Option("ACTION", &arguments->action, "What to do")
      .OneOf({kList, kExclude, kInclude, kHold})
      .Option(
          "RUN",
          &arguments->runs,
          "SHA-256 of a log, or UUID of a report, or how it begins; or the name of a mapped log")
      .Option("--vehicle", &arguments->vehicle, "All runs of a vehicle")
      .Time("--since", &arguments->since_s, "To exclude or hold: those that begin then or later")
      .Option("--reason", &arguments->reason, "For the audit log; to exclude or hold")
      .Option("--version",
              &arguments->store.version,
              "To list: map version (default: the published one)")
      .Flag("--all", &arguments->all, "To list: those of the version's ancestors too")
      .Check([arguments] { return Misused(*arguments); })
      .Watchable([arguments] { return arguments->action == kList; })
      .Writes();
}

}  // namespace shiftmap
