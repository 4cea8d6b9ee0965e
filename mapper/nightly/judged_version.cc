// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/judged_version.h"

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "mapstore/cli/context.h"

namespace shiftmap {
namespace {

std::vector<std::string> Lines(const Json& document, const char* key) {
  std::vector<std::string> lines;
  const auto found = document.find(key);
  if (found == document.end() || !found->is_array()) return lines;
  for (const Json& line : *found) {
    if (line.is_string()) lines.push_back(line.get<std::string>());
  }
  return lines;
}

}  // namespace

BuildOutcome ReadOutcome(const std::string& configuration) {
  BuildOutcome outcome;
  const Json document = Json::parse(configuration, nullptr, false);
  if (!document.is_object()) return outcome;
  if (document.contains("night") && document["night"].is_string()) {
    outcome.night = document["night"].get<std::string>();
  }
  const Json said = document.value("outcome", Json::object());
  if (!said.is_object()) return outcome;
  const Json chi2 = said.value("chi2", Json());
  const Json observations = said.value("observations", Json());
  const Json outliers = said.value("outliers", Json());
  if (chi2.is_number() && observations.is_number() && outliers.is_number()) {
    const double used = observations.get<double>() - outliers.get<double>();
    if (used > 0.0) outcome.cost = chi2.get<double>() / used;
  }
  outcome.left_out = Lines(said, "left_out");
  outcome.waiting = Lines(said, "waiting");
  outcome.at_two_places = Lines(said, "at_two_places");
  return outcome;
}

bool JudgedVersion::Has(const LogHead& log) const {
  return std::any_of(provenance.runs.begin(), provenance.runs.end(), [&](const RunRecord& run) {
    return log.IsOf(run);
  });
}

StatusOr<JudgedVersion> LoadJudged(const std::string& area,
                                   const VersionSummary& version,
                                   Provenance provenance,
                                   MapStore* store) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapSnapshot map, store->LoadVersion(area, version.version));
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<EvidenceRow> rows, store->Evidence(area, version.version));
  return JudgedVersion{
      version.version, version.parent, std::move(map), std::move(provenance), std::move(rows)};
}

StatusOr<JudgedVersion> JudgedBuild(const std::string& area,
                                    const AreaBuild& build,
                                    MapStore* store) {
  const std::optional<VersionNumber> parent = build.commit_options.parent;
  std::map<Signature, Signature> aliases;
  std::vector<EvidenceRow> rows;
  if (parent) {
    SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot before, store->LoadVersion(area, *parent));
    aliases = before.aliases();
    std::set<std::string> runs;
    for (const RunRecord& run : build.provenance.runs) {
      runs.insert(run.sha256);
      runs.insert(run.identity());
    }
    SHIFTMAP_ASSIGN_OR_RETURN(rows, store->Evidence(area, *parent, runs));
  }
  for (const RunRecord& run : build.provenance.runs) {
    for (const VisitEvidence& visit : run.evidence) {
      rows.push_back({run.sha256, visit, run.vehicle});
    }
  }
  const MapContent& content = build.result.content;
  return JudgedVersion{std::nullopt,
                       parent,
                       MapSnapshot(area,
                                   parent.value_or(VersionNumber(0)),
                                   GeometryHash(content),
                                   content,
                                   LedgerPosition(),
                                   std::move(aliases)),
                       build.provenance,
                       std::move(rows)};
}

}  // namespace shiftmap
