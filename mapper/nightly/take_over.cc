// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/take_over.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <tuple>
#include <utility>
#include <vector>

#include "mapper/nightly/since_published.h"

namespace shiftmap {
namespace {

using RowsBySource = std::map<std::string, std::vector<VisitEvidence>>;

// What a version says of the runs of its ancestors: the rows of its line that its parent's does not
// have.
StatusOr<std::vector<RunRecord>> OlderRuns(const std::string& area,
                                           VersionNumber parent,
                                           RowsBySource rows,
                                           MapStore* from) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::set<std::string> line, from->RunIdentities(area, parent));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<EvidenceRow> known, from->Evidence(area, parent));
  std::set<std::tuple<std::string, Signature, Stamp, Stamp>> keys;
  for (const EvidenceRow& row : known) {
    const VisitEvidence& visit = row.evidence;
    keys.emplace(row.source, visit.signature, visit.begin, visit.end);
  }
  std::vector<RunRecord> older;
  for (auto& of_source : rows) {
    const std::string& source = of_source.first;
    std::vector<VisitEvidence>& visits = of_source.second;
    if (!line.contains(source)) continue;
    std::erase_if(visits, [&](const VisitEvidence& visit) {
      return keys.contains({source, visit.signature, visit.begin, visit.end});
    });
    if (visits.empty()) continue;
    RunRecord run;
    run.name = run.sha256 = source;
    run.begin = Stamp::max();
    run.end = Stamp::min();
    for (const VisitEvidence& visit : visits) {
      run.begin = std::min(run.begin, visit.begin);
      run.end = std::max(run.end, visit.end);
    }
    run.evidence = std::move(visits);
    older.push_back(std::move(run));
  }
  return older;
}

// A version's provenance with what its runs say, as it was committed.
StatusOr<Provenance> WholeProvenance(const std::string& area,
                                     VersionNumber version,
                                     std::optional<VersionNumber> parent,
                                     MapStore* from) {
  SHIFTMAP_ASSIGN_OR_RETURN(Provenance provenance, from->LoadProvenance(area, version));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::set<std::string> line, from->RunIdentities(area, version));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<EvidenceRow> rows, from->Evidence(area, version));
  RowsBySource by_source;
  for (const EvidenceRow& row : rows) by_source[row.source].push_back(row.evidence);
  for (RunRecord& run : provenance.runs) {
    run.evidence = by_source[run.sha256];
    std::set<std::string> others = line;
    others.erase(run.sha256);
    others.erase(run.identity());
    SHIFTMAP_ASSIGN_OR_RETURN(run.visibility, from->MappedVisibility(area, version, others));
    by_source.erase(run.sha256);
  }
  if (parent) {
    SHIFTMAP_ASSIGN_OR_RETURN(provenance.older, OlderRuns(area, *parent, by_source, from));
  }
  return provenance;
}

Status TakeVersion(const std::string& area,
                   const VersionSummary& summary,
                   MapStore* from,
                   MapStore* to) {
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, from->LoadVersion(area, summary.version));
  SHIFTMAP_ASSIGN_OR_RETURN(const Provenance provenance,
                            WholeProvenance(area, summary.version, summary.parent, from));
  CommitOptions options;
  options.parent = summary.parent;
  options.publish = false;
  options.states_probabilities = false;
  if (summary.parent) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> before,
                              from->EditsOf(area, *summary.parent));
    SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> after,
                              from->EditsOf(area, summary.version));
    for (const MapEdit& edit : before) {
      const bool held = std::any_of(
          after.begin(), after.end(), [&](const MapEdit& of) { return of.id == edit.id; });
      if (!held) options.without_edits.push_back(edit.id);
    }
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const CommitResult commit,
                            to->Commit(area, map.content(), provenance, options));
  if (commit.version == summary.version && commit.content_hash == summary.content_hash) {
    return OkStatus();
  }
  return Internal("area '{}': version {} with content {} became version {} with content {}",
                  area,
                  summary.version.value(),
                  summary.content_hash,
                  commit.version.value(),
                  commit.content_hash);
}

template <typename T>
StatusOr<std::vector<T>> OrNone(StatusOr<std::vector<T>> result) {
  if (result.status().code() == StatusCode::kNotFound) return std::vector<T>();
  return result;
}

Status TakeVersions(const std::string& area, const AreaBase& base, MapStore* from, MapStore* to) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto theirs, OrNone(from->Versions(area)));
  SHIFTMAP_ASSIGN_OR_RETURN(const auto ours, OrNone(to->Versions(area)));
  for (const VersionSummary& our : ours) {
    if (our.version <= base.newest) continue;
    const bool same = std::any_of(theirs.begin(), theirs.end(), [&](const auto& their) {
      return their.version == our.version && their.content_hash == our.content_hash &&
             their.parent == our.parent;
    });
    if (same) continue;
    return MakeStatus(StatusCode::kAborted,
                      "area '{}': version {} was made since the night was planned",
                      area,
                      our.version.value());
  }
  const VersionNumber newest = ours.empty() ? base.newest : ours.back().version;
  for (const VersionSummary& their : theirs) {
    if (their.version <= std::max(newest, base.newest)) continue;
    SHIFTMAP_RETURN_IF_ERROR(TakeVersion(area, their, from, to));
  }
  return OkStatus();
}

// The two parts of a subject.
std::pair<std::string, std::string> Split(const std::string& text, const std::string& at) {
  const std::size_t found = text.find(at);
  if (found == std::string::npos) return {text, ""};
  return {text.substr(0, found), text.substr(found + at.size())};
}

Status TakeEntry(const std::string& area,
                 const AuditEntry& entry,
                 const AreaBase& base,
                 MapStore* to) {
  if (entry.Is(AuditAction::kWait)) {
    const auto [hash, name] = Split(entry.subject, " ");
    return to->NoteWaiting(area, {{name, hash, {}}});
  }
  if (entry.Is(AuditAction::kRefuse)) return to->AddNote(area, NightNote::kRefused, entry.subject);
  if (entry.Is(AuditAction::kLeave)) return to->AddNote(area, NightNote::kLeftOut, entry.subject);
  if (entry.Is(AuditAction::kHold)) {
    const auto [run, reason] = Split(entry.subject.substr(std::string("run ").size()), ": ");
    Exclusion hold;
    hold.run = run;
    hold.reason = reason;
    hold.held = true;
    const Status held = to->Exclude(area, hold);
    return held.code() == StatusCode::kAlreadyExists ? OkStatus() : held;
  }
  if (entry.Is(AuditAction::kPublish)) {
    return to->Publish(area, VersionOf(entry), base.published);
  }
  return OkStatus();
}

}  // namespace

Status TakeOver(const std::string& area, const AreaBase& base, MapStore* from, MapStore* to) {
  SHIFTMAP_RETURN_IF_ERROR(TakeVersions(area, base, from, to));
  SHIFTMAP_ASSIGN_OR_RETURN(const auto theirs, OrNone(from->AuditLog(area)));
  SHIFTMAP_ASSIGN_OR_RETURN(const auto ours, OrNone(to->AuditLog(area)));
  std::set<std::pair<std::string, std::string>> there;
  for (std::size_t i = base.audit; i < ours.size(); ++i) {
    there.emplace(ours[i].action, ours[i].subject);
  }
  for (std::size_t i = base.audit; i < theirs.size(); ++i) {
    if (there.contains({theirs[i].action, theirs[i].subject})) continue;
    SHIFTMAP_RETURN_IF_ERROR(TakeEntry(area, theirs[i], base, to));
  }
  return OkStatus();
}

}  // namespace shiftmap
