// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/judge.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <string_view>
#include <utility>

#include "mapper/nightly/clock_check.h"
#include "mapstore/codec/run_log.h"
#include "mapstore/core/quantile.h"
#include "mapstore/map/map_diff.h"

namespace shiftmap {
namespace {

// What a map may be worse by and still be published.
constexpr double kNisMargin = 0.2231;  // Of ln max(1, NIS per degree of freedom): ln 1.25.
constexpr double kDoubtMargin = 0.05;  // Of the share of time INITIALIZING, LOST or UNKNOWN_CHANGE.
constexpr double kDecisionMargin = 0.1;  // Of the share of landmarks that are not decided right.

// What a build's squared residuals per observation may grow by from the published one's.
constexpr double kCostFactor = 2.0;

// A run of the build that fits neither map while the others fit is suspect: it is LOST for more
// than this share of its time, sees more than this share of landmarks at no place of theirs, or has
// more NIS per degree of freedom. Each must also exceed the median of the others by the factor.
constexpr double kSuspectLostShare = 0.15;
constexpr double kSuspectUngatedShare = 0.15;
constexpr double kSuspectNis = 3.0;
constexpr double kSuspectFactor = 2.0;

// A displacement that chance gives once in so many modes is no chance.
constexpr double kMovedProbability = 1e-4;

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

// By how much the new map is worse for each shift. A run gains on a map that was built from it by
// overfitting: its gain counts only as far as the fold without it shows it.
std::vector<double> Differences(const Judgement& judgement,
                                const std::function<double(const ShiftScore&)>& of) {
  std::map<std::string, double> least;  // Difference of each run in its fold.
  for (const JudgedShift& shift : judgement.shifts) {
    if (shift.before && shift.fold > 0) least[shift.run] = of(shift.after) - of(*shift.before);
  }
  std::vector<double> differences;
  for (const JudgedShift& shift : judgement.shifts) {
    if (!shift.before || shift.fold > 0) continue;
    const double d = of(shift.after) - of(*shift.before);
    differences.push_back(shift.in_build ? std::max(least[shift.run], d) : d);
  }
  return differences;
}

void Test(Judgement* judgement) {
  struct Measure {
    const char* name;
    const char* words;
    double margin;
    std::function<double(const ShiftScore&)> of;
  };
  const std::vector<Measure> measures = {
      {"nis",
       "ln NIS per degree of freedom",
       kNisMargin,
       [](const ShiftScore& score) { return std::log(std::max(1.0, score.nis_per_dof())); }},
      {"doubt",
       "share of time INITIALIZING, LOST or UNKNOWN_CHANGE",
       kDoubtMargin,
       [](const ShiftScore& score) { return score.doubt_share(); }},
      {"decisions",
       "share of landmarks that are not decided for the mode that the mapper found",
       kDecisionMargin,
       [](const ShiftScore& score) { return score.wrong_share(); }}};
  for (const Measure& measure : measures) {
    const PairedTestResult result = PairedTest(Differences(*judgement, measure.of), measure.margin);
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

// A score of which a run of the build must not have much more than the others.
struct SuspectMeasure {
  std::function<double(const ShiftScore&)> of;
  double allowed = 0.0;
  double usual = 0.0;  // The least that counts as the median of the others.
  std::function<std::string(double own, double others)> reason;
};

std::vector<SuspectMeasure> SuspectMeasures() {
  const auto share = [](std::string_view before, std::string_view after) {
    return [before, after](double own, double others) {
      return fmt::format("{}{:.0f} % {}, {:.0f} % in the median of the others",
                         before,
                         100.0 * own,
                         after,
                         100.0 * others);
    };
  };
  return {{[](const ShiftScore& score) { return score.nis_per_dof(); },
           kSuspectNis,
           1.0,
           [](double own, double others) {
             return fmt::format(
                 "NIS per degree of freedom is {:.1f}, {:.1f} in the median of the others",
                 own,
                 others);
           }},
          {[](const ShiftScore& score) { return score.unlocalized_share(); },
           kSuspectLostShare,
           0.0,
           share("it is lost for ", "of its time")},
          {[](const ShiftScore& score) { return score.ungated_share(); },
           kSuspectUngatedShare,
           0.0,
           share("", "of its observations fit no place of their landmarks")}};
}

void FindSuspects(Judgement* judgement) {
  const std::vector<SuspectMeasure> measures = SuspectMeasures();
  for (const JudgedShift& shift : judgement->shifts) {
    if (!shift.in_build) continue;
    for (const SuspectMeasure& measure : measures) {
      std::vector<double> others;
      for (const JudgedShift& other : judgement->shifts) {
        if (other.run != shift.run && other.fold == 0) others.push_back(Least(other, measure.of));
      }
      if (others.empty()) continue;
      const double own = Least(shift, measure.of);
      const double median = Median(others);
      if (own <= measure.allowed || own <= kSuspectFactor * std::max(measure.usual, median)) {
        continue;
      }
      judgement->suspects.push_back(
          {shift.path, "fits neither the old map nor the new one: " + measure.reason(own, median)});
      break;
    }
  }
}

class Replays {
 public:
  // @param rows  Of the version that is judged.
  Replays(const std::optional<MapSnapshot>& before,
          const std::vector<EvidenceRow>& rows,
          const std::function<Status()>& on_step)
      : before_(before), rows_(rows), go_on_(on_step) {}

  // Of a log that can be replayed no more nothing comes.
  Status Add(const LogHead& log,
             const JudgedVersion& after,
             bool in_build,
             int fold,
             std::vector<JudgedShift>* shifts) const {
    SHIFTMAP_RETURN_IF_ERROR(go_on_());
    const StatusOr<RunLog> read = ReadRunLog(log.path, {.lidar_scans = false});
    if (!read.ok()) return OkStatus();
    const Run& run = read->run;
    JudgedShift shift{log.path, log.identity(), run.info.vehicle, in_build, fold, {}, {}, {}};
    FoundModes found = FindModes(rows_, read->sha256);
    if (fold > 0 && before_) KeepModesOf(*before_, &found);
    const auto replay = [&](const MapSnapshot& map) {
      return Replay(run, KnownBefore(map, after.rows, log.begin), found, go_on_);
    };
    if (before_ && in_build) {
      const auto score = replay(WithCalibrationOf(after.map, *before_));
      if (!score.ok()) return Stopped(score.status());
      shift.as_calibrated_before = *score;
    }
    if (before_) {
      const auto score = replay(*before_);
      if (!score.ok()) return Stopped(score.status());
      shift.before = *score;
    }
    const auto score = replay(after.map);
    if (!score.ok()) return Stopped(score.status());
    shift.after = *score;
    shifts->push_back(std::move(shift));
    return OkStatus();
  }

 private:
  static Status Stopped(const Status& status) {
    return status.code() == StatusCode::kInvalidArgument ? OkStatus() : status;
  }

  // Leaves the landmarks that stood where the map has a mode.
  static void KeepModesOf(const MapSnapshot& map, FoundModes* found) {
    std::erase_if(*found, [&](const auto& of) {
      const int group = map.GroupIndex(of.first);
      return group < 0 ||
             map.groups()[static_cast<std::size_t>(group)].CarriedStateOf(of.second) < 0;
    });
  }

  const std::optional<MapSnapshot>& before_;
  const std::vector<EvidenceRow>& rows_;
  const std::function<Status()>& go_on_;
};

std::vector<LogHead> Used(const JudgedVersion& version, const JudgedLogs& logs) {
  std::vector<LogHead> used = logs.built;
  std::erase_if(used, [&](const LogHead& log) { return !version.Has(log); });
  return used;
}

// Of new logs those that judged no refused version; all if none is left.
std::vector<LogHead> Unspent(const std::vector<LogHead>& fresh, const JudgedLogs& logs) {
  std::vector<LogHead> unspent = fresh;
  std::erase_if(unspent, [&](const LogHead& log) { return log.begin <= logs.refused.until; });
  return unspent.empty() ? fresh : unspent;
}

// The build's shifts that judge it.
std::vector<LogHead> OwnJudges(const JudgedVersion& version,
                               const JudgedLogs& logs,
                               std::size_t max_shifts) {
  return Newest(Unspent(Used(version, logs), logs), max_shifts);
}

// The mapped shifts that judge, after those that judged refused versions.
std::vector<LogHead> MappedJudges(const JudgedLogs& logs,
                                  std::size_t max_shifts,
                                  std::size_t count) {
  const std::size_t spent =
      std::min(static_cast<std::size_t>(logs.refused.count) * max_shifts, logs.mapped.size());
  std::vector<LogHead> judges = Newest(logs.mapped, spent + count);
  judges.erase(judges.begin(), judges.begin() + static_cast<std::ptrdiff_t>(spent));
  return judges;
}

Status ReplayAll(const JudgedVersion& version,
                 const JudgedLogs& logs,
                 std::size_t max_shifts,
                 const Replays& replays,
                 Judgement* judgement) {
  // All that the build took are looked at; half of the others at least come from older days.
  for (const LogHead& log : OwnJudges(version, logs, max_shifts)) {
    SHIFTMAP_RETURN_IF_ERROR(replays.Add(log, version, true, 0, &judgement->shifts));
  }
  const std::vector<LogHead> unseen = Newest(Unspent(logs.held_out, logs), max_shifts / 2 + 1);
  for (const LogHead& log : unseen) {
    SHIFTMAP_RETURN_IF_ERROR(replays.Add(log, version, false, 0, &judgement->shifts));
  }
  const std::size_t left = max_shifts - std::min(max_shifts, unseen.size());
  for (const LogHead& log : MappedJudges(logs, max_shifts, left)) {
    SHIFTMAP_RETURN_IF_ERROR(replays.Add(log, version, false, 0, &judgement->shifts));
  }
  return OkStatus();
}

// Replays the build's shifts on maps that are built without them.
Status ReplayFolds(const JudgedVersion& version,
                   const JudgedLogs& logs,
                   const JudgeOptions& options,
                   const FoldBuilder& build,
                   const Replays& replays,
                   Judgement* judgement) {
  const std::vector<LogHead> judges =
      OwnJudges(version, logs, static_cast<std::size_t>(options.max_shifts));
  const std::size_t folds =
      std::min(static_cast<std::size_t>(std::max(0, options.max_folds)), judges.size());
  if (options.max_folds < 2) return OkStatus();
  for (std::size_t fold = 0; fold < folds; ++fold) {
    std::vector<LogHead> part;
    for (std::size_t i = fold; i < judges.size(); i += folds) part.push_back(judges[i]);
    std::vector<LogHead> without = Used(version, logs);
    std::erase_if(without, [&](const LogHead& log) {
      return std::any_of(
          part.begin(), part.end(), [&](const LogHead& of) { return of.path == log.path; });
    });
    if (without.empty()) continue;
    SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<JudgedVersion> map, build(without));
    if (!map) continue;
    for (const LogHead& log : part) {
      SHIFTMAP_RETURN_IF_ERROR(
          replays.Add(log, *map, false, static_cast<int>(fold) + 1, &judgement->shifts));
    }
  }
  return OkStatus();
}

bool AnyShift(const Judgement& judgement, bool in_build, bool in_fold) {
  return std::any_of(judgement.shifts.begin(), judgement.shifts.end(), [&](const auto& shift) {
    return shift.before && shift.in_build == in_build && (shift.fold > 0) == in_fold;
  });
}

JudgedBy BasisOf(const Judgement& judgement) {
  const bool folds = AnyShift(judgement, false, true);
  if (AnyShift(judgement, false, false)) {
    return folds ? JudgedBy::kShiftsAndFolds : JudgedBy::kShifts;
  }
  if (folds) return JudgedBy::kFolds;
  return AnyShift(judgement, true, false) ? JudgedBy::kOwnShifts : JudgedBy::kNothing;
}

}  // namespace

StatusOr<Judgement> Judge(const std::string& area,
                          const JudgedVersion& version,
                          const JudgedLogs& logs,
                          const JudgeOptions& options,
                          const FoldBuilder& build,
                          MapStore* store,
                          const std::function<Status()>& on_step) {
  Judgement judgement;
  judgement.after = version.number;
  judgement.before = version.parent;
  judgement.cost_after = ReadOutcome(version.provenance.configuration).cost;
  std::optional<MapSnapshot> before;
  if (judgement.before) {
    SHIFTMAP_ASSIGN_OR_RETURN(before, store->LoadVersion(area, *judgement.before));
    SHIFTMAP_ASSIGN_OR_RETURN(judgement.cost_before, CostOf(area, *judgement.before, store));
    CountChanges(before->content(), version.map.content(), &judgement);
  }
  SHIFTMAP_RETURN_IF_ERROR(CheckClocks(area, version, logs.built, store, &judgement));
  const Replays replays(before, version.rows, on_step);
  SHIFTMAP_RETURN_IF_ERROR(
      ReplayAll(version, logs, static_cast<std::size_t>(options.max_shifts), replays, &judgement));
  FindSuspects(&judgement);
  // One that is built again anyway needs no other judge.
  const bool alone = !AnyShift(judgement, false, false) || logs.refused.count > 0;
  if (before && judgement.suspects.empty() && alone) {
    SHIFTMAP_RETURN_IF_ERROR(ReplayFolds(version, logs, options, build, replays, &judgement));
  }
  judgement.judged_by = BasisOf(judgement);
  Test(&judgement);
  if (judgement.cost_before && judgement.cost_after &&
      *judgement.cost_after > kCostFactor * std::max(*judgement.cost_before, 1.0)) {
    judgement.worse.push_back(fmt::format("cost per observation is {:.2f}, and was {:.2f}",
                                          *judgement.cost_after,
                                          *judgement.cost_before));
  }
  if (judgement.modes_removed > 0 || judgement.landmarks_removed > 0) {
    judgement.worse.push_back(fmt::format("{} landmarks and {} modes are gone that nobody retired",
                                          judgement.landmarks_removed,
                                          judgement.modes_removed));
  }
  return judgement;
}

}  // namespace shiftmap
