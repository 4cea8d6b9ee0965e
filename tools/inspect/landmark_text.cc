// SPDX-License-Identifier: Apache-2.0
#include "tools/inspect/landmark_text.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

#include "mapstore/cli/aligned_table.h"
#include "mapstore/core/count_text.h"
#include "mapstore/core/day.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/core/mode_name.h"
#include "mapstore/geometry/covariance.h"
#include "tools/inspect/move_rate_estimate.h"
#include "tools/inspect/store_arguments.h"

namespace shiftmap {
namespace {

constexpr double kLeastLogOdds = 0.05;  // Less is shown as nothing. [nat]

// Odds from their logarithm, to two digits; beyond a billion nobody counts.
std::string OddsText(double log_odds) {
  constexpr double kMost = 1e9;
  const double odds = std::exp(std::min(log_odds, std::log(kMost)));
  if (odds >= kMost) return ">1e9:1";
  if (odds < 1e4) return fmt::format("{:.{}f}:1", odds, odds < 10.0 ? 1 : 0);
  const double exponent = std::floor(std::log10(odds));
  return fmt::format("{:.1f}e{:.0f}:1", odds / std::pow(10.0, exponent), exponent);
}

std::string ProbabilityText(double probability) { return fmt::format("{:.4f}", probability); }

const ModeProbability* MostProbable(const std::vector<ModeProbability>& modes) {
  const auto best = std::max_element(modes.begin(), modes.end(), [](const auto& a, const auto& b) {
    return a.probability < b.probability;
  });
  return best == modes.end() ? nullptr : &*best;
}

// Who made the row, from which run.
std::string SourceText(const HistoryVisit& visit) {
  return visit.mapped ? fmt::format("build of {}", visit.version.value())
                      : fmt::format("shift on {}", visit.version.value());
}

std::string RunText(const HistoryVisit& visit) {
  return visit.run_name.empty() ? ShortHash(visit.run) : visit.run_name;
}

// What a visit says that leaves several modes equally likely: which one it speaks against.
std::string TieText(const HistoryVisit& visit) {
  const auto [least, most] = std::minmax_element(
      visit.log_likelihoods.begin(), visit.log_likelihoods.end(), [](const auto& a, const auto& b) {
        return a.log_likelihood < b.log_likelihood;
      });
  if (least == visit.log_likelihoods.end()) return "nothing";
  const double log_odds = most->log_likelihood - least->log_likelihood;
  if (log_odds < kLeastLogOdds) return "nothing";
  return fmt::format("not {} {}", ModeName(least->mode), OddsText(log_odds));
}

// What the visit says by itself.
std::string EvidenceText(const HistoryVisit& visit) {
  if (visit.log_odds < kLeastLogOdds) return TieText(visit);
  const bool elsewhere = visit.likely_mode == kAbsent && visit.observations > 0;
  if (elsewhere) return fmt::format("elsewhere {}", OddsText(visit.log_odds));
  return fmt::format("{} {}", ModeName(visit.likely_mode), OddsText(visit.log_odds));
}

std::string DecisionText(const HistoryVisit& visit) {
  if (!visit.decision) return "-";
  return fmt::format("{} {}", ModeName(visit.decision->mode), OddsText(visit.decision->log_odds));
}

std::size_t FirstShown(const LandmarkHistory& history, std::size_t limit) {
  const std::size_t visits = history.visits.size();
  return limit == 0 || visits <= limit ? 0 : visits - limit;
}

MoveRateEstimate MoveRateOf(const LandmarkHistory& history) {
  std::vector<Stamp> times;
  for (const HistoryVisit& visit : history.visits) {
    if (!visit.set_aside) times.push_back(visit.begin);
  }
  return EstimateMoveRate(
      history.move_rate_per_s, static_cast<int>(history.probabilities.size()), times);
}

Json VersionsJson(const std::vector<VersionNumber>& versions) {
  Json list = Json::array();
  for (const VersionNumber version : versions) list.push_back(version.value());
  return list;
}

Json PositionJson(const ModePosition& position) {
  const Eigen::Matrix2d& cov = position.cov_p_map_landmark;
  return {{"version", position.version.value()},
          {"x_m", position.p_map_landmark.x()},
          {"y_m", position.p_map_landmark.y()},
          {"cov_m2", {cov(0, 0), cov(0, 1), cov(1, 1)}}};
}

Json ModeJson(const ModeHistory& mode, const std::vector<HistoryVisit>& visits) {
  Json positions = Json::array();
  for (const ModePosition& position : mode.positions) positions.push_back(PositionJson(position));
  const auto stamp = [&](const std::optional<std::size_t>& visit) {
    return visit ? Json(ToSecondsSinceEpoch(visits[*visit].begin)) : Json(nullptr);
  };
  return {{"mode", mode.number.value()},
          {"position", PositionJson(mode.position)},
          {"probability", mode.probability},
          {"gone", mode.gone},
          {"merged_into", mode.merged_into ? Json(mode.merged_into->value()) : Json(nullptr)},
          {"first_version", mode.first_version.value()},
          {"first_version_or_before", mode.or_before},
          {"visits", mode.visits},
          {"first_visit_s", stamp(mode.first_visit)},
          {"last_visit_s", stamp(mode.last_visit)},
          {"positions", positions}};
}

Json VisitJson(const HistoryVisit& visit) {
  Json log_likelihoods = Json::object();
  for (const VisitEvidence::ModeLogLikelihood& mode : visit.log_likelihoods) {
    log_likelihoods[fmt::format("{}", mode.mode.value())] = mode.log_likelihood;
  }
  Json decision = nullptr;
  if (visit.decision) {
    decision = {{"mode", visit.decision->mode.value()},
                {"stamp_s", ToSecondsSinceEpoch(visit.decision->stamp)},
                {"log_odds", visit.decision->log_odds}};
  }
  return {
      {"begin_s", ToSecondsSinceEpoch(visit.begin)},
      {"end_s", ToSecondsSinceEpoch(visit.end)},
      {"vehicle", visit.vehicle},
      {"run", visit.run},
      {"run_name", visit.run_name},
      {"source", visit.mapped ? "build" : "shift"},
      {"report", visit.report.empty() ? Json(nullptr) : Json(visit.report)},
      {"version", visit.version.value()},
      {"arrived_s", ToSecondsSinceEpoch(visit.arrived)},
      {"observations", visit.observations},
      {"log_likelihoods", log_likelihoods},
      {"likely_mode", visit.likely_mode.value()},
      {"log_odds", visit.log_odds},
      {"current_mode", visit.current_mode ? Json(visit.current_mode->value()) : Json(nullptr)},
      {"known_since_version", visit.known_since ? Json(visit.known_since->value()) : Json(nullptr)},
      {"known_since_or_before", visit.or_before},
      {"decision", decision},
      {"set_aside", visit.set_aside ? Json(Describe(*visit.set_aside)) : Json(nullptr)},
      {"probabilities",
       visit.probabilities.empty() ? Json(nullptr) : ProbabilitiesJson(visit.probabilities)}};
}

// What became of a mode.
std::string NoteText(const ModeHistory& mode) {
  if (mode.merged_into) return fmt::format("merged into mode {}", mode.merged_into->value());
  if (mode.gone) return "gone";
  if (mode.positions.size() < 2) return "";
  const ModePosition& now = mode.positions.back();
  const ModePosition& before = mode.positions[mode.positions.size() - 2];
  return fmt::format("moved {:.2f} m in version {}",
                     (now.p_map_landmark - before.p_map_landmark).norm(),
                     now.version.value());
}

std::string DurationText(double seconds) {
  if (seconds < 120.0) return fmt::format("{:.0f} s", seconds);
  if (seconds < 7200.0) return fmt::format("{:.0f} min", seconds / 60.0);
  return seconds < kSecondsPerDay ? fmt::format("{:.1f} h", seconds / 3600.0)
                                  : fmt::format("{:.1f} days", seconds / kSecondsPerDay);
}

// The last visit that counts, in words.
std::string LastVisitText(const LandmarkHistory& history) {
  const auto last = std::find_if(history.visits.rbegin(),
                                 history.visits.rend(),
                                 [](const HistoryVisit& visit) { return !visit.set_aside; });
  if (last == history.visits.rend()) return "no visit counts";
  return fmt::format("last visit that counts: {} UTC, {} earlier, {} ({}), seen in {}, says {}",
                     TimeText(last->begin),
                     DurationText(ToSeconds(history.stamp - last->begin)),
                     InertLine(last->vehicle),
                     SourceText(*last),
                     CountText(last->observations, "scan"),
                     EvidenceText(*last));
}

}  // namespace

std::string VerdictText(const LandmarkHistory& history) {
  std::string text = fmt::format("{} in area {}, version {}, at {} UTC",
                                 InertLine(history.signature.text()),
                                 InertLine(history.area),
                                 history.version.value(),
                                 TimeText(history.stamp));
  if (history.known) text += fmt::format(", as known at {} UTC", TimeText(*history.known));
  const ModeProbability* const best = MostProbable(history.probabilities);
  if (best == nullptr) {
    text += ": the version does not have the landmark";
  } else if (IsDecided(best->probability)) {
    text += fmt::format(": {}, probability {:.4f}", ModeName(best->mode), best->probability);
  } else {
    text += fmt::format(": undecided, no state is more probable than {:.4f}", best->probability);
  }
  const auto aside = std::count_if(history.visits.begin(), history.visits.end(), [](const auto& v) {
    return v.set_aside.has_value();
  });
  text += history.visits.empty()
              ? std::string("\nno visit yet\n")
              : fmt::format("\n{}\n{}{}\n",
                            LastVisitText(history),
                            CountText(history.visits.size(), "visit"),
                            aside > 0 ? fmt::format(", {} set aside", aside) : "");
  if (history.statement) {
    text += fmt::format("version {} states its probabilities at {} UTC; they count as evidence\n",
                        history.statement->version.value(),
                        TimeText(history.statement->probabilities.stamp));
  }
  return text;
}

std::string ModesText(const LandmarkHistory& history, const TextStyle& style) {
  AlignedTable table({"mode",
                      "x_m",
                      "y_m",
                      "sd_m",
                      "probability",
                      "last_seen",
                      "note",
                      "visits",
                      "since_version",
                      "first_seen"});
  if (!history.probabilities.empty()) {
    table.AddRow({"absent",
                  "-",
                  "-",
                  "-",
                  ProbabilityText(history.probabilities.front().probability),
                  "-",
                  "",
                  "-",
                  "-",
                  "-"});
  }
  for (const ModeHistory& mode : history.modes) {
    const auto seen = [&](const std::optional<std::size_t>& visit) {
      return visit ? TimeText(history.visits[*visit].begin) : std::string("-");
    };
    table.AddRow({fmt::format("{}", mode.number.value()),
                  fmt::format("{:.3f}", mode.position.p_map_landmark.x()),
                  fmt::format("{:.3f}", mode.position.p_map_landmark.y()),
                  fmt::format("{:.3f}", LargestSd(mode.position.cov_p_map_landmark)),
                  mode.gone ? "-" : ProbabilityText(mode.probability),
                  seen(mode.last_visit),
                  NoteText(mode),
                  fmt::format("{}", mode.visits),
                  fmt::format("{}{}", mode.or_before ? "<=" : "", mode.first_version.value()),
                  seen(mode.first_visit)},
                 mode.gone ? Emphasis::kFaint : Emphasis::kNone);
  }
  return table.ToString(style);
}

std::string MoveRateText(const LandmarkHistory& history) {
  if (!(history.move_rate_per_s > 0.0)) return "";
  const MoveRateEstimate rate = MoveRateOf(history);
  return fmt::format(
      "moves {:.3g} times a day in the long run (95 % interval {:.3g} to {:.3g}, from {}), once in "
      "{:.3g} days\n",
      kSecondsPerDay * rate.rate_per_s,
      kSecondsPerDay * rate.low_per_s,
      kSecondsPerDay * rate.high_per_s,
      CountText(rate.visits, "visit"),
      1.0 / (kSecondsPerDay * rate.rate_per_s));
}

std::string VisitsText(const LandmarkHistory& history, std::size_t limit, const TextStyle& style) {
  if (history.visits.empty()) return "no visits\n";
  std::vector<std::string> header = {"visit", "says"};
  for (const ModeProbability& mode : history.probabilities) {
    header.push_back(mode.mode == kAbsent ? "P(absent)" : fmt::format("P({})", mode.mode.value()));
  }
  header.insert(header.end(),
                {"counts", "decided", "vehicle", "run", "seen", "from", "duration_s"});
  AlignedTable table(header);
  const std::size_t first = FirstShown(history, limit);
  for (std::size_t i = first; i < history.visits.size(); ++i) {
    const HistoryVisit& visit = history.visits[i];
    std::vector<std::string> row = {TimeText(visit.begin), EvidenceText(visit)};
    for (std::size_t k = 0; k < history.probabilities.size(); ++k) {
      row.push_back(
          visit.probabilities.empty() ? "-" : ProbabilityText(visit.probabilities[k].probability));
    }
    row.insert(row.end(),
               {visit.set_aside ? fmt::format("no: {}", Describe(*visit.set_aside)) : "yes",
                DecisionText(visit),
                visit.vehicle,
                RunText(visit),
                fmt::format("{}", visit.observations),
                SourceText(visit),
                fmt::format("{:.1f}", ToSeconds(visit.end - visit.begin))});
    table.AddRow(std::move(row), visit.set_aside ? Emphasis::kFaint : Emphasis::kNone);
  }
  std::string text = table.ToString(style);
  if (first > 0) {
    text += fmt::format("not shown: {}; history --limit 0 shows all\n",
                        CountText(first, "older visit"));
  }
  return text;
}

std::string TrackText(const LandmarkHistory& history, const TextStyle& style) {
  std::vector<std::string> header = {"time"};
  for (const ModeProbability& mode : history.probabilities) header.push_back(ModeName(mode.mode));
  AlignedTable table(header);
  for (const ModeProbabilities& at : history.track) {
    std::vector<std::string> row = {TimeText(at.stamp)};
    for (std::size_t k = 0; k < history.probabilities.size(); ++k) {
      row.push_back(at.modes.empty() ? "-" : ProbabilityText(at.modes[k].probability));
    }
    table.AddRow(std::move(row));
  }
  return table.ToString(style);
}

Json ProbabilitiesJson(const std::vector<ModeProbability>& modes) {
  Json json = Json::object();
  for (const ModeProbability& mode : modes) {
    json[fmt::format("{}", mode.mode.value())] = mode.probability;
  }
  return json;
}

Json HistoryJson(const LandmarkHistory& history, std::size_t limit) {
  Json track = Json::array();
  for (const ModeProbabilities& at : history.track) {
    track.push_back({{"stamp_s", ToSecondsSinceEpoch(at.stamp)},
                     {"probabilities", ProbabilitiesJson(at.modes)}});
  }
  Json modes = Json::array();
  for (const ModeHistory& mode : history.modes) modes.push_back(ModeJson(mode, history.visits));
  Json visits = Json::array();
  for (std::size_t i = FirstShown(history, limit); i < history.visits.size(); ++i) {
    visits.push_back(VisitJson(history.visits[i]));
  }
  const MoveRateEstimate rate = MoveRateOf(history);
  Json statement = nullptr;
  if (history.statement) {
    statement = {{"version", history.statement->version.value()},
                 {"stamp_s", ToSecondsSinceEpoch(history.statement->probabilities.stamp)},
                 {"probabilities", ProbabilitiesJson(history.statement->probabilities.modes)}};
  }
  return {{"area", history.area},
          {"version", history.version.value()},
          {"signature", history.signature.text()},
          {"history", track},
          {"stamp_s", ToSecondsSinceEpoch(history.stamp)},
          {"known_s", history.known ? Json(ToSecondsSinceEpoch(*history.known)) : Json(nullptr)},
          {"probabilities", ProbabilitiesJson(history.probabilities)},
          {"move_rate_per_s",
           {{"value", rate.rate_per_s},
            {"interval_95", {rate.low_per_s, rate.high_per_s}},
            {"visits", rate.visits}}},
          {"modes", modes},
          {"visits", visits},
          {"statement", statement},
          {"versions", VersionsJson(history.versions)},
          {"mapped_by", VersionsJson(history.mapped_by)}};
}

}  // namespace shiftmap
