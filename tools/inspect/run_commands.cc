// SPDX-License-Identifier: Apache-2.0
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/cli/aligned_table.h"
#include "mapstore/cli/store_access.h"
#include "mapstore/core/inert_text.h"
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
  double since_s = 0.0;
  std::string reason;
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
std::string ExclusionsText(const std::vector<Exclusion>& exclusions) {
  if (exclusions.empty()) return "";
  AlignedTable table({"state", "what", "since", "decided", "reason"});
  for (const Exclusion& exclusion : exclusions) {
    const bool run = exclusion.vehicle.empty();
    table.AddRow({StateText(exclusion),
                  run ? "run " + exclusion.run : "vehicle " + exclusion.vehicle,
                  run ? "" : TimeText(exclusion.since),
                  TimeText(exclusion.excluded),
                  exclusion.reason});
  }
  return "\n" + table.ToString();
}

Status List(const StoreArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<Exclusion> exclusions,
                            store.Exclusions(arguments.area));
  SHIFTMAP_ASSIGN_OR_RETURN(std::optional<VersionNumber> version,
                            store.PublishedVersion(arguments.area));
  if (arguments.version) version = VersionNumber(*arguments.version);
  Provenance provenance;
  if (version) {
    SHIFTMAP_ASSIGN_OR_RETURN(provenance, store.LoadProvenance(arguments.area, *version));
  }
  Json list = Json::array();
  AlignedTable table({"run", "vehicle", "begin", "duration_s", "sha256", "state"});
  for (const RunRecord& run : provenance.runs) {
    const Exclusion* const exclusion =
        FindExclusion(exclusions, run.identity(), run.vehicle, run.begin);
    const std::string state = exclusion == nullptr ? "" : StateText(*exclusion);
    list.push_back({{"run", run.name},
                    {"vehicle", run.vehicle},
                    {"sha256", run.sha256},
                    {"begin_s", ToSecondsSinceEpoch(run.begin)},
                    {"end_s", ToSecondsSinceEpoch(run.end)},
                    {"state", state.empty() ? Json(nullptr) : Json(state)}});
    table.AddRow(
        {run.name,
         run.vehicle,
         TimeText(run.begin),
         fmt::format("{:.1f}", ToSecondsSinceEpoch(run.end) - ToSecondsSinceEpoch(run.begin)),
         ShortHash(run.sha256),
         state});
  }
  Json taken_out = Json::array();
  for (const Exclusion& exclusion : exclusions) taken_out.push_back(ExclusionJson(exclusion));
  const Json document = {{"area", arguments.area},
                         {"version", version ? Json(version->value()) : Json(nullptr)},
                         {"tool", provenance.tool},
                         {"seed", provenance.seed},
                         {"runs", list},
                         {"exclusions", taken_out}};
  context.Report(document, table.ToString() + ExclusionsText(exclusions));
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
    exclusions.push_back(
        {"", arguments.vehicle, StampFromSeconds(arguments.since_s), arguments.reason, held});
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
  for (const std::string& run : runs) {
    context.Warn(
        fmt::format("version {} is made from run '{}', which is excluded: the next build goes on "
                    "from the newest ancestor without it",
                    published->value(),
                    run));
  }
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
  for (const Exclusion& exclusion : Named(arguments)) {
    SHIFTMAP_RETURN_IF_ERROR(include ? store.Include(area, exclusion, context.dry_run())
                                     : store.Exclude(area, exclusion, context.dry_run()));
    list.push_back(ExclusionJson(exclusion));
    if (include) list.back()["state"] = "included";
    const bool run = exclusion.vehicle.empty();
    text += fmt::format("{} {}: {}\n",
                        run ? "run" : "vehicle",
                        InertLine(run ? exclusion.run : exclusion.vehicle),
                        include ? "included again" : StateText(exclusion));
  }
  SHIFTMAP_RETURN_IF_ERROR(WarnOfPublished(area, &store, context));
  context.Report({{"area", area}, {"changed", list}}, text);
  return OkStatus();
}

std::string Misused(const RunsArguments& arguments) {
  const bool named = !arguments.runs.empty() || !arguments.vehicle.empty();
  if (arguments.action == kList) {
    const bool idle = named || !arguments.reason.empty() || arguments.since_s > 0.0;
    return idle ? "list takes no runs, --vehicle, --since or --reason" : "";
  }
  if (!named) return "expected runs, or --vehicle";
  if (arguments.store.version) return "--version is for list";
  if (arguments.since_s > 0.0 && arguments.vehicle.empty()) return "--since is for --vehicle";
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
        return arguments->action == kList ? List(arguments->store, context)
                                          : Change(*arguments, context);
      });
  AddStoreOptions(&arguments->store, &command);
  command.Option("ACTION", &arguments->action, "What to do")
      .OneOf({kList, kExclude, kInclude, kHold})
      .Option("RUN", &arguments->runs, "SHA-256 of a log, or UUID of a report, or how it begins")
      .Option("--vehicle", &arguments->vehicle, "All runs of a vehicle")
      .Option("--since", &arguments->since_s, "Of these: that begin then, seconds since the epoch")
      .InRange(0.0, 9.2e9)
      .Option("--reason", &arguments->reason, "For the audit log; to exclude or hold")
      .Option("--version",
              &arguments->store.version,
              "To list: map version (default: the published one)")
      .Check([arguments] { return Misused(*arguments); })
      .Writes();
}

}  // namespace shiftmap
