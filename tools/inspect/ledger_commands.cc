// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>
#include <vector>

#include "mapstore/cli/aligned_table.h"
#include "tools/inspect/inspect_commands.h"
#include "tools/inspect/store_arguments.h"

namespace shiftmap {
namespace {

Json SetAsideJson(const std::vector<SetAsideRows>& set_aside) {
  Json list = Json::array();
  for (const SetAsideRows& rows : set_aside) {
    list.push_back({{"reason", Describe(rows.reason)}, {"rows", rows.rows}});
  }
  return list;
}

// With what the operator said who took the run out.
std::string SetAsideText(const ReportSummary& report, const Exclusion* exclusion) {
  std::string text;
  for (const SetAsideRows& rows : report.set_aside) {
    text += fmt::format("{}{}: {}", text.empty() ? "" : "; ", rows.rows, Describe(rows.reason));
    const bool taken_out = rows.reason == SetAside::kExcluded || rows.reason == SetAside::kHeld;
    if (taken_out && exclusion != nullptr) text += fmt::format(" ({})", exclusion->reason);
  }
  return text;
}

struct LedgerArguments : StoreArguments {
  std::optional<double> since_s;
  std::optional<std::int64_t> limit;
};

bool IsOlder(Stamp stamp, const LedgerArguments& arguments) {
  return arguments.since_s && stamp < StampFromSeconds(*arguments.since_s);
}

Status RunReports(const LedgerArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionNumber version, SelectVersion(arguments, &store));
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<ReportSummary> reports,
                            store.Reports(arguments.area, version));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<Exclusion> exclusions,
                            store.Exclusions(arguments.area));
  std::erase_if(reports, [&](const auto& report) { return IsOlder(report.end, arguments); });
  Json list = Json::array();
  AlignedTable table({"end",
                      "vehicle",
                      "rows",
                      "counting",
                      "not_counting",
                      "version",
                      "report",
                      "decisions",
                      "sightings"});
  table.KeepWide(4, 40);
  for (const ReportSummary& report : reports) {
    const Exclusion* const exclusion =
        FindExclusion(exclusions, report.run, report.run_hash, report.vehicle, report.begin);
    list.push_back({{"uuid", report.uuid},
                    {"vehicle", report.vehicle},
                    {"version", report.version.value()},
                    {"run_hash", report.run_hash},
                    {"software", report.software},
                    {"begin_s", ToSecondsSinceEpoch(report.begin)},
                    {"end_s", ToSecondsSinceEpoch(report.end)},
                    {"received_s", ToSecondsSinceEpoch(report.received)},
                    {"evidence_rows", report.evidence_rows},
                    {"decisions", report.decisions},
                    {"sightings", report.sightings},
                    {"set_aside", SetAsideJson(report.set_aside)},
                    {"exclusion_reason", exclusion ? Json(exclusion->reason) : Json(nullptr)}});
    int aside = 0;
    for (const SetAsideRows& rows : report.set_aside) aside += rows.rows;
    table.AddRow({TimeText(report.end),
                  report.vehicle,
                  fmt::format("{}", report.evidence_rows),
                  fmt::format("{}", report.evidence_rows - aside),
                  SetAsideText(report, exclusion),
                  fmt::format("{}", report.version.value()),
                  ShortHash(report.uuid),
                  fmt::format("{}", report.decisions),
                  fmt::format("{}", report.sightings)},
                 aside > 0 && aside == report.evidence_rows ? Emphasis::kFaint : Emphasis::kNone);
  }
  context.Report({{"area", arguments.area}, {"version", version.value()}, {"reports", list}},
                 table.ToString(context.style(), "no reports"));
  return OkStatus();
}

Status RunAudit(const LedgerArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments, context));
  std::optional<std::string> area;
  if (!arguments.area.empty()) area = arguments.area;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<AuditEntry> entries, store.AuditLog(area));
  const auto all = static_cast<std::int64_t>(entries.size());
  std::int64_t skipped = std::max<std::int64_t>(all - arguments.limit.value_or(all), 0);
  Json list = Json::array();
  AlignedTable table({"written", "area", "action", "subject"});
  for (const AuditEntry& entry : entries) {
    if (skipped-- > 0 || IsOlder(entry.written, arguments)) continue;
    list.push_back({{"written_s", ToSecondsSinceEpoch(entry.written)},
                    {"area", entry.area},
                    {"action", entry.action},
                    {"subject", entry.subject}});
    table.AddRow({TimeText(entry.written), entry.area, entry.action, entry.subject});
  }
  context.Report({{"audit", list}}, table.ToString(context.style(), "no writes"));
  return OkStatus();
}

}  // namespace

void AddLedgerCommands(Application* application) {
  auto reports = std::make_shared<LedgerArguments>();
  Command& reports_command = application->AddCommand(
      "reports",
      "List the shift reports of an area, and which of their rows count for a map version",
      [reports](Context& context) { return RunReports(*reports, context); });
  AddStoreOptions(reports.get(), &reports_command);
  reports_command.Option("--version", &reports->version, "Map version (default: the published one)")
      .Time("--since", &reports->since_s, "Of shifts that did not end before")
      .Watchable();

  auto audit = std::make_shared<LedgerArguments>();
  Command& audit_command =
      application->AddCommand("audit", "List every write to a store", [audit](Context& context) {
        return RunAudit(*audit, context);
      });
  audit_command.Option("--store", &audit->store, "Map store").Required();
  audit_command.Option("--area", &audit->area, "Of one area only")
      .Time("--since", &audit->since_s, "Written then or later")
      .Option("--limit", &audit->limit, "The newest so many")
      .InRange(0, 1e9)
      .Watchable();
}

}  // namespace shiftmap
