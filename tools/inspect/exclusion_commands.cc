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

struct ExclusionArguments {
  StoreArguments store;
  std::vector<std::string> runs;
  std::string vehicle;
  double since_s = 0.0;
  std::string reason;
};

// One per run, or the vehicle's.
std::vector<Exclusion> Named(const ExclusionArguments& arguments) {
  std::vector<Exclusion> exclusions;
  for (const std::string& run : arguments.runs) {
    exclusions.push_back({run, "", {}, arguments.reason, {}});
  }
  if (!arguments.vehicle.empty()) {
    exclusions.push_back(
        {"", arguments.vehicle, StampFromSeconds(arguments.since_s), arguments.reason, {}});
  }
  return exclusions;
}

Json ExclusionJson(const Exclusion& exclusion) {
  if (exclusion.vehicle.empty()) {
    return {{"run", exclusion.run}, {"reason", exclusion.reason}};
  }
  return {{"vehicle", exclusion.vehicle},
          {"since_s", ToSecondsSinceEpoch(exclusion.since)},
          {"reason", exclusion.reason}};
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
                    "from the newest "
                    "ancestor without it",
                    published->value(),
                    run));
  }
  return OkStatus();
}

Status Change(const ExclusionArguments& arguments, bool exclude, Context& context) {
  const std::vector<Exclusion> exclusions = Named(arguments);
  const auto access =
      context.dry_run() ? MapStore::Access::kReadOnly : MapStore::Access::kReadWrite;
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments.store.store, access, context));
  Json list = Json::array();
  std::string text;
  for (const Exclusion& exclusion : exclusions) {
    const std::string& area = arguments.store.area;
    SHIFTMAP_RETURN_IF_ERROR(exclude ? store.Exclude(area, exclusion, context.dry_run())
                                     : store.Include(area, exclusion, context.dry_run()));
    list.push_back(ExclusionJson(exclusion));
    text += fmt::format("{} {}: {}\n",
                        exclusion.vehicle.empty() ? "run" : "vehicle",
                        InertLine(exclusion.vehicle.empty() ? exclusion.run : exclusion.vehicle),
                        exclude ? "excluded" : "included again");
  }
  SHIFTMAP_RETURN_IF_ERROR(WarnOfPublished(arguments.store.area, &store, context));
  context.Report({{"area", arguments.store.area}, {exclude ? "excluded" : "included", list}}, text);
  return OkStatus();
}

Status List(const StoreArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<Exclusion> exclusions,
                            store.Exclusions(arguments.area));
  Json list = Json::array();
  AlignedTable table({"excluded", "what", "since", "reason"});
  for (const Exclusion& exclusion : exclusions) {
    list.push_back(ExclusionJson(exclusion));
    const bool run = exclusion.vehicle.empty();
    table.AddRow({TimeText(exclusion.excluded),
                  run ? "run " + exclusion.run : "vehicle " + exclusion.vehicle,
                  run ? "" : TimeText(exclusion.since),
                  exclusion.reason});
  }
  context.Report({{"area", arguments.area}, {"exclusions", list}}, table.ToString());
  return OkStatus();
}

void AddNames(ExclusionArguments* arguments, Command* command) {
  AddStoreOptions(&arguments->store, command);
  command->Option("--vehicle", &arguments->vehicle, "All runs of a vehicle")
      .Option("RUN", &arguments->runs, "SHA-256 of a log, or UUID of a report, or how it begins")
      .Check([arguments] {
        const bool named = !arguments->runs.empty() || !arguments->vehicle.empty();
        return std::string(named ? "" : "expected runs, or --vehicle");
      });
}

}  // namespace

void AddExclusionCommands(Application* application) {
  auto exclude = std::make_shared<ExclusionArguments>();
  Command& exclude_command = application->AddCommand(
      "exclude",
      "Take runs out of an area's memory: probabilities and rates are as if they had never come",
      [exclude](Context& context) { return Change(*exclude, true, context); });
  AddNames(exclude.get(), &exclude_command);
  exclude_command
      .Option(
          "--since", &exclude->since_s, "With --vehicle: that begin then, seconds since the epoch")
      .InRange(0.0, 9.2e9);
  exclude_command.Option("--reason", &exclude->reason, "For the audit log").Required();
  exclude_command.Writes();

  auto include = std::make_shared<ExclusionArguments>();
  Command& include_command = application->AddCommand(
      "include",
      "Take an exclusion back: all numbers are as they were",
      [include](Context& context) { return Change(*include, false, context); });
  AddNames(include.get(), &include_command);
  include_command.Option("--reason", &include->reason, "For the audit log");
  include_command.Writes();

  auto list = std::make_shared<StoreArguments>();
  Command& list_command = application->AddCommand(
      "exclusions", "List what is excluded, and why", [list](Context& context) {
        return List(*list, context);
      });
  AddStoreOptions(list.get(), &list_command);
}

}  // namespace shiftmap
