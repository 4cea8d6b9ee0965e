// SPDX-License-Identifier: Apache-2.0
#include <memory>
#include <nlohmann/json.hpp>

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

std::string SetAsideText(const std::vector<SetAsideRows>& set_aside) {
  std::string text;
  for (const SetAsideRows& rows : set_aside) {
    text += fmt::format("{}{}: {}", text.empty() ? "" : "; ", rows.rows, Describe(rows.reason));
  }
  return text;
}

Status RunReports(const StoreArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionNumber version, SelectVersion(arguments, &store));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<ReportSummary> reports,
                            store.Reports(arguments.area, version));
  Json list = Json::array();
  AlignedTable table({"end", "vehicle", "version", "rows", "decisions", "sightings", "set_aside"});
  for (const ReportSummary& report : reports) {
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
                    {"set_aside", SetAsideJson(report.set_aside)}});
    table.AddRow({TimeText(report.end),
                  report.vehicle,
                  fmt::format("{}", report.version.value()),
                  fmt::format("{}", report.evidence_rows),
                  fmt::format("{}", report.decisions),
                  fmt::format("{}", report.sightings),
                  SetAsideText(report.set_aside)});
  }
  context.Report({{"area", arguments.area}, {"version", version.value()}, {"reports", list}},
                 table.ToString());
  return OkStatus();
}

Status RunAudit(const StoreArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments, context));
  std::optional<std::string> area;
  if (!arguments.area.empty()) area = arguments.area;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<AuditEntry> entries, store.AuditLog(area));
  Json list = Json::array();
  AlignedTable table({"written", "area", "action", "subject"});
  for (const AuditEntry& entry : entries) {
    list.push_back({{"written_s", ToSecondsSinceEpoch(entry.written)},
                    {"area", entry.area},
                    {"action", entry.action},
                    {"subject", entry.subject}});
    table.AddRow({TimeText(entry.written), entry.area, entry.action, entry.subject});
  }
  context.Report({{"audit", list}}, table.ToString());
  return OkStatus();
}

}  // namespace

void AddLedgerCommands(Application* application) {
  auto reports = std::make_shared<StoreArguments>();
  Command& reports_command = application->AddCommand(
      "reports",
      "List the shift reports of an area, and which of their rows count for a map version",
      [reports](Context& context) { return RunReports(*reports, context); });
  AddStoreOptions(reports.get(), &reports_command);
  reports_command.Option(
      "--version", &reports->version, "Map version (default: the published one)");

  auto audit = std::make_shared<StoreArguments>();
  Command& audit_command =
      application->AddCommand("audit", "List every write to a store", [audit](Context& context) {
        return RunAudit(*audit, context);
      });
  audit_command.Option("--store", &audit->store, "Map store").Required();
  audit_command.Option("--area", &audit->area, "Of one area only");
}

}  // namespace shiftmap
