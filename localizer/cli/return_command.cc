// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "localizer/cli/return_to_store.h"
#include "mapstore/cli/stop_signals.h"
#include "mapstore/cli/store_access.h"
#include "mapstore/codec/shift_report.h"
#include "mapstore/core/clock.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/map_store.h"

namespace shiftmap {

Json ReturnedJson(const ReturnResult& result) {
  Json set_aside = Json::array();
  for (const SetAsideRows& rows : result.set_aside) {
    set_aside.push_back({{"reason", Describe(rows.reason)}, {"rows", rows.rows}});
  }
  return {{"evidence_rows", result.evidence_rows}, {"set_aside", set_aside}};
}

std::string ReturnedText(const ReturnResult& result) {
  std::string text = fmt::format("{} evidence rows\n", result.evidence_rows);
  for (const SetAsideRows& rows : result.set_aside) {
    text += fmt::format("  {} of them kept aside: {}\n", rows.rows, Describe(rows.reason));
  }
  return text;
}

void WarnOfUnsetClock(const std::string& what, const ShiftReport& report, const Context& context) {
  const Status set = CheckClockWasSet(what, report.begin);
  if (!set.ok()) context.Warn(Message(set) + ": its visits count as older than all others");
}

Status ReturnToStore(const ReturnArguments& options, Context& context) {
  const StopSignals signals;
  // All are read before the first is returned: a bad file changes nothing.
  std::vector<ShiftReport> reports;
  for (const std::string& path : options.reports) {
    SHIFTMAP_ASSIGN_OR_RETURN(ShiftReport report, ReadShiftReport(path));
    reports.push_back(std::move(report));
  }
  if (context.dry_run()) {
    SHIFTMAP_RETURN_IF_ERROR(MapStore::CheckWritable(options.store, true));
  }
  const auto access =
      context.dry_run() ? MapStore::Access::kReadOnly : MapStore::Access::kReadWrite;
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store,
                            OpenStore(options.store, access, context, options.clock_tolerance_s));
  for (std::size_t i = 0; i < reports.size(); ++i) {
    SHIFTMAP_RETURN_IF_ERROR(
        Annotate(store.CheckClock(reports[i]), "shift report '{}'", options.reports[i]));
    WarnOfUnsetClock(fmt::format("shift report '{}'", options.reports[i]), reports[i], context);
  }
  Json results = Json::array();
  std::string text;
  bool all_known = true;
  Status stopped;
  for (std::size_t i = 0; i < reports.size() && !context.dry_run(); ++i) {
    stopped = StopSignals::Check(
        fmt::format("map store '{}': return", options.store),
        fmt::format("{} of {} files are done, the same command goes on", i, reports.size()));
    if (!stopped.ok()) break;
    SHIFTMAP_ASSIGN_OR_RETURN(const ReturnResult result, store.Return(reports[i]));
    all_known = all_known && result.duplicate;
    Json document = ReturnedJson(result);
    document["report"] = options.reports[i];
    document["uuid"] = reports[i].uuid;
    document["duplicate"] = result.duplicate;
    results.push_back(std::move(document));
    text += fmt::format("{}: {}",
                        InertLine(options.reports[i]),
                        result.duplicate ? "known already\n" : ReturnedText(result));
  }
  context.Report({{"reports", results}}, text);
  SHIFTMAP_RETURN_IF_ERROR(stopped);
  if (all_known && !context.dry_run()) {
    return MakeStatus(
        StatusCode::kAlreadyExists, "map store '{}': every report is known already", options.store);
  }
  return OkStatus();
}

}  // namespace shiftmap
