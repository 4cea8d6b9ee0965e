// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/judge.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "mapstore/cli/context.h"
#include "mapstore/codec/run_log.h"
#include "mapstore/core/clock.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/core/quantile.h"
#include "mapstore/map/map_diff.h"

namespace shiftmap {
namespace {

// A displacement that chance gives once in so many modes is no chance.
constexpr double kMovedProbability = 1e-4;

StatusOr<std::optional<VersionNumber>> ParentOf(const std::string& area,
                                                VersionNumber version,
                                                MapStore* store) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<VersionSummary> versions, store->Versions(area));
  for (const VersionSummary& summary : versions) {
    if (summary.version == version) return summary.parent;
  }
  return NotFound("area '{}': no version {}", area, version.value());
}

StatusOr<std::optional<double>> CostOf(const std::string& area,
                                       VersionNumber version,
                                       MapStore* store) {
  SHIFTMAP_ASSIGN_OR_RETURN(const Provenance provenance, store->LoadProvenance(area, version));
  return ReadOutcome(provenance.configuration).cost;
}

// Of several logs the newest, but of the vehicles in turn.
std::vector<LogHead> Newest(std::vector<LogHead> logs, std::size_t count) {
  std::sort(logs.begin(), logs.end(), [](const LogHead& a, const LogHead& b) {
    return std::tie(b.begin, b.path) < std::tie(a.begin, a.path);
  });
  std::map<std::string, int> taken;
  std::map<std::string, int> rank;
  for (const LogHead& log : logs) rank[log.path] = taken[log.info.vehicle]++;
  std::stable_sort(logs.begin(), logs.end(), [&](const LogHead& a, const LogHead& b) {
    return rank[a.path] < rank[b.path];
  });
  logs.resize(std::min(logs.size(), count));
  return logs;
}

void CountChanges(const MapContent& before, const MapContent& after, Judgement* judgement) {
  const MapDiff diff = DiffMaps(before, after);
  judgement->landmarks_made = static_cast<int>(diff.groups_added.size());
  judgement->landmarks_removed = static_cast<int>(diff.groups_removed.size());
  for (const Signature& signature : diff.groups_added) {
    for (const LandmarkGroup& group : after.groups) {
      if (group.signature == signature) {
        judgement->modes_made += static_cast<int>(group.modes.size());
      }
    }
  }
  for (const GroupDiff& group : diff.groups) {
    judgement->modes_made += static_cast<int>(group.added.size());
    judgement->modes_removed += static_cast<int>(group.removed.size());
    judgement->modes_merged += static_cast<int>(group.merged.size());
    const bool moved = std::any_of(group.moved.begin(), group.moved.end(), [](const auto& mode) {
      return mode.p_value < kMovedProbability;
    });
    if (moved) judgement->moved.push_back(group.signature.text());
  }
}

// One-sided; what a run that made the map gains on it is no proof.
double Difference(const JudgedShift& shift, const std::function<double(const ShiftScore&)>& of) {
  const double d = of(shift.after) - of(*shift.before);
  return shift.in_build ? std::max(0.0, d) : d;
}

void Test(const JudgeOptions& options, Judgement* judgement) {
  struct Measure {
    const char* name;
    const char* words;
    double margin;
    std::function<double(const ShiftScore&)> of;
  };
  const std::vector<Measure> measures = {
      {"nis",
       "ln NIS per degree of freedom",
       options.nis_margin,
       [](const ShiftScore& score) { return std::log(std::max(1.0, score.nis_per_dof())); }},
      {"doubt",
       "share of time INITIALIZING, LOST or UNKNOWN_CHANGE",
       options.doubt_margin,
       [](const ShiftScore& score) { return score.doubt_share(); }},
      {"decisions",
       "share of landmarks that are not decided for the mode that the mapper found",
       options.decision_margin,
       [](const ShiftScore& score) { return score.wrong_share(); }}};
  for (const Measure& measure : measures) {
    std::vector<double> differences;
    for (const JudgedShift& shift : judgement->shifts) {
      if (shift.before) differences.push_back(Difference(shift, measure.of));
    }
    const PairedTestResult result = PairedTest(differences, {.margin = measure.margin});
    judgement->tests.push_back({measure.name, result});
    if (result.not_worse()) continue;
    judgement->worse.push_back(
        fmt::format("{}: over {} shifts it is worse by {:.3f} in the mean, by {:.3f} at most with "
                    "95 %, allowed "
                    "are {:.3f}",
                    measure.words,
                    result.shifts,
                    result.mean,
                    result.upper,
                    result.margin));
  }
}

double Median(const std::vector<double>& values) {
  return values.empty() ? 0.0 : Quantile(values, 0.5);
}

// The better of both maps: a layout that changed is no fault of the run.
double Least(const JudgedShift& shift, const std::function<double(const ShiftScore&)>& of) {
  const ShiftScore& after = shift.as_calibrated_before.value_or(shift.after);
  return shift.before ? std::min(of(*shift.before), of(after)) : of(after);
}

// The geometry and chains of one map with the calibration of another.
MapSnapshot WithCalibrationOf(const MapSnapshot& map, const MapSnapshot& other) {
  MapContent content = map.content();
  content.calibration.odometry = other.content().calibration.odometry;
  content.vehicles = other.content().vehicles;
  return WithContent(map, std::move(content));
}

void FindSuspects(const JudgeOptions& options, Judgement* judgement) {
  const auto nis = [](const ShiftScore& score) { return score.nis_per_dof(); };
  const auto lost = [](const ShiftScore& score) { return score.astray_share(); };
  for (const JudgedShift& shift : judgement->shifts) {
    if (!shift.in_build) continue;
    std::vector<double> other_nis;
    std::vector<double> other_lost;
    for (const JudgedShift& other : judgement->shifts) {
      if (other.run == shift.run) continue;
      other_nis.push_back(Least(other, nis));
      other_lost.push_back(Least(other, lost));
    }
    if (other_nis.empty()) continue;
    const double own_nis = Least(shift, nis);
    const double own_lost = Least(shift, lost);
    std::string reason;
    if (own_nis > options.suspect_nis &&
        own_nis > options.suspect_factor * std::max(1.0, Median(other_nis))) {
      reason =
          fmt::format("NIS per degree of freedom is {:.1f}, {:.1f} in the median of the others",
                      own_nis,
                      Median(other_nis));
    } else if (own_lost > options.suspect_lost_share &&
               own_lost > options.suspect_factor * Median(other_lost)) {
      reason = fmt::format(
          "it is lost for {:.0f} % of its time, {:.0f} % in the median of "
          "the others",
          100.0 * own_lost,
          100.0 * Median(other_lost));
    }
    if (reason.empty()) continue;
    judgement->suspects.push_back(
        {shift.path, "fits neither the old map nor the new one: " + reason});
  }
}

// A vehicle is in one run at a time.
void FindWrongClocks(const std::vector<RunRecord>& runs,
                     const std::vector<EvidenceRow>& rows,
                     const std::vector<LogHead>& logs,
                     Judgement* judgement) {
  for (const RunRecord& run : runs) {
    if (run.vehicle.empty()) continue;
    const auto other = std::find_if(rows.begin(), rows.end(), [&](const EvidenceRow& row) {
      return row.vehicle == run.vehicle && row.source != run.sha256 &&
             row.evidence.begin < run.end && row.evidence.end > run.begin;
    });
    if (other == rows.end()) continue;
    const auto log = std::find_if(logs.begin(), logs.end(), [&](const LogHead& of) {
      return of.identity() == run.identity() || of.identity() == run.sha256;
    });
    if (log == logs.end()) continue;
    judgement->suspects.push_back(
        {log->path,
         fmt::format("its clock is wrong: vehicle '{}' was in another run at {} UTC",
                     InertLine(run.vehicle),
                     FormatUtc(other->evidence.begin))});
  }
}

class Replays {
 public:
  Replays(std::optional<MapSnapshot> before,
          MapSnapshot after,
          std::vector<EvidenceRow> rows,
          const std::function<Status()>& go_on)
      : before_(std::move(before)),
        after_(std::move(after)),
        rows_(std::move(rows)),
        go_on_(go_on) {}

  // Of a log that can be replayed no more nothing comes.
  Status Add(const LogHead& log, bool in_build, std::vector<JudgedShift>* shifts) const {
    SHIFTMAP_RETURN_IF_ERROR(go_on_());
    const StatusOr<RunLog> read = ReadRunLog(log.path, {.lidar_scans = false});
    if (!read.ok()) return OkStatus();
    const Run& run = read->run;
    JudgedShift shift{log.path, log.identity(), run.info.vehicle, in_build, {}, {}, {}};
    const FoundModes found = FindModes(rows_, read->sha256);
    if (before_ && in_build) {
      const MapSnapshot mixed = KnownBefore(WithCalibrationOf(after_, *before_), rows_, log.begin);
      const auto score = Replay(run, mixed, found, go_on_);
      if (!score.ok()) return Stopped(score.status());
      shift.as_calibrated_before = *score;
    }
    if (before_) {
      const auto score = Replay(run, KnownBefore(*before_, rows_, log.begin), found, go_on_);
      if (!score.ok()) return Stopped(score.status());
      shift.before = *score;
    }
    const auto score = Replay(run, KnownBefore(after_, rows_, log.begin), found, go_on_);
    if (!score.ok()) return Stopped(score.status());
    shift.after = *score;
    shifts->push_back(std::move(shift));
    return OkStatus();
  }

 private:
  static Status Stopped(const Status& status) {
    return status.code() == StatusCode::kInvalidArgument ? OkStatus() : status;
  }

  std::optional<MapSnapshot> before_;
  MapSnapshot after_;
  std::vector<EvidenceRow> rows_;
  const std::function<Status()>& go_on_;
};

Status ReplayAll(const JudgedLogs& logs,
                 const std::set<std::string>& built,
                 std::size_t max_shifts,
                 const Replays& replays,
                 Judgement* judgement) {
  // All that the build took are looked at; half of the others at least come from older days.
  std::vector<LogHead> used = logs.built;
  std::erase_if(used, [&](const LogHead& log) {
    return !built.contains(log.identity()) && !built.contains(log.sha256);
  });
  for (const LogHead& log : Newest(std::move(used), max_shifts)) {
    SHIFTMAP_RETURN_IF_ERROR(replays.Add(log, true, &judgement->shifts));
  }
  const std::vector<LogHead> unseen = Newest(logs.held_out, max_shifts / 2 + 1);
  for (const LogHead& log : unseen) {
    SHIFTMAP_RETURN_IF_ERROR(replays.Add(log, false, &judgement->shifts));
  }
  for (const LogHead& log : Newest(logs.mapped, max_shifts - std::min(max_shifts, unseen.size()))) {
    SHIFTMAP_RETURN_IF_ERROR(replays.Add(log, false, &judgement->shifts));
  }
  return OkStatus();
}

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
  return outcome;
}

StatusOr<Judgement> Judge(const std::string& area,
                          VersionNumber version,
                          const JudgedLogs& logs,
                          const JudgeOptions& options,
                          MapStore* store,
                          const std::function<Status()>& go_on) {
  Judgement judgement;
  judgement.after = version;
  SHIFTMAP_ASSIGN_OR_RETURN(judgement.before, ParentOf(area, version, store));
  SHIFTMAP_ASSIGN_OR_RETURN(const Provenance provenance, store->LoadProvenance(area, version));
  const BuildOutcome outcome = ReadOutcome(provenance.configuration);
  judgement.cost_after = outcome.cost;
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot after, store->LoadVersion(area, version));
  std::optional<MapSnapshot> before;
  if (judgement.before) {
    SHIFTMAP_ASSIGN_OR_RETURN(before, store->LoadVersion(area, *judgement.before));
    SHIFTMAP_ASSIGN_OR_RETURN(judgement.cost_before, CostOf(area, *judgement.before, store));
    CountChanges(before->content(), after.content(), &judgement);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<EvidenceRow> rows, store->Evidence(area, version));
  std::set<std::string> built;
  for (const RunRecord& run : provenance.runs) {
    built.insert(run.identity());
    built.insert(run.sha256);
  }
  FindWrongClocks(provenance.runs, rows, logs.built, &judgement);
  const Replays replays(std::move(before), after, std::move(rows), go_on);
  SHIFTMAP_RETURN_IF_ERROR(
      ReplayAll(logs, built, static_cast<std::size_t>(options.max_shifts), replays, &judgement));
  Test(options, &judgement);
  if (judgement.cost_before && judgement.cost_after &&
      *judgement.cost_after > options.cost_factor * std::max(*judgement.cost_before, 1.0)) {
    judgement.worse.push_back(fmt::format("cost per observation is {:.2f}, and was {:.2f}",
                                          *judgement.cost_after,
                                          *judgement.cost_before));
  }
  if (judgement.modes_removed > 0 || judgement.landmarks_removed > 0) {
    judgement.worse.push_back(fmt::format("{} landmarks and {} modes are gone that nobody retired",
                                          judgement.landmarks_removed,
                                          judgement.modes_removed));
  }
  FindSuspects(options, &judgement);
  return judgement;
}

}  // namespace shiftmap
