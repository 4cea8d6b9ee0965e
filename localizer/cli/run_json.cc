// SPDX-License-Identifier: Apache-2.0
#include "localizer/cli/run_json.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "localizer/cli/hypothesis_json.h"
#include "localizer/cli/return_to_store.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/core/quantile.h"

namespace shiftmap {
namespace {

// 0 for none.
double LatencyMs(const RunSummary& summary, double share) {
  return summary.latencies_ms.empty() ? 0.0 : Quantile(summary.latencies_ms, share);
}

Json StatesJson(const LocalizerStatistics& statistics) {
  Json states = Json::object();
  for (std::size_t i = 0; i < kLocalizerStates; ++i) {
    states[ToString(static_cast<LocalizerState>(i))] = statistics.seconds_in_state[i];
  }
  return states;
}

Json DecisionsJson(const Localizer& localizer) {
  Json decisions = Json::array();
  for (const Decision& decision : localizer.decisions()) {
    decisions.push_back({{"signature", decision.signature.text()},
                         {"mode", decision.mode.value()},
                         {"stamp_s", ToSecondsSinceEpoch(decision.stamp)},
                         {"log_odds", decision.log_odds}});
  }
  return decisions;
}

Json ProbabilitiesJson(const Localizer& localizer) {
  Json groups = Json::array();
  const std::vector<LandmarkGroup>& all = localizer.snapshot().groups();
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Eigen::VectorXd p = localizer.Probabilities(static_cast<int>(i));
    Json probabilities = Json::object();
    for (int state = 0; state < p.size(); ++state) {
      probabilities[std::to_string(all[i].NumberOf(state).value())] = p[state];
    }
    groups.push_back({{"signature", all[i].signature.text()}, {"probabilities", probabilities}});
  }
  return groups;
}

Json SightingsJson(const Localizer& localizer) {
  Json sightings = Json::array();
  for (const UnmappedSighting& sighting : localizer.Sightings()) {
    sightings.push_back({{"signature", sighting.signature.text()},
                         {"x_m", sighting.p_map_landmark.x()},
                         {"y_m", sighting.p_map_landmark.y()},
                         {"count", sighting.count}});
  }
  return sightings;
}

Json StateChangesJson(const Localizer& localizer) {
  Json changes = Json::array();
  for (const StateChange& change : localizer.state_changes()) {
    const StateEvidence& evidence = change.evidence;
    Json why = {{"stamp_s", ToSecondsSinceEpoch(evidence.stamp)},
                {"agreeing", evidence.support.agreeing},
                {"failing", evidence.support.failing},
                {"since_s", ToSecondsSinceEpoch(evidence.support.since)},
                {"nis_sum", evidence.support.nis_sum},
                {"updates", evidence.support.updates}};
    if (!evidence.signature.anonymous()) {
      why["signature"] = evidence.signature.text();
      if (change.to == LocalizerState::kUnknownChange) {
        why["sightings"] = evidence.sightings;
      } else {
        why["mode"] = evidence.mode.value();
        why["log_odds"] = evidence.log_odds;
      }
    }
    changes.push_back({{"stamp_s", ToSecondsSinceEpoch(change.stamp)},
                       {"from", ToString(change.from)},
                       {"to", ToString(change.to)},
                       {"why", why}});
  }
  return changes;
}

double MeanNis(const LocalizerStatistics& statistics) {
  if (statistics.updates == 0) return 0.0;
  return statistics.nis_sum / static_cast<double>(statistics.updates);
}

// Whose calibration the localizer used.
std::string CalibrationOwner(const Localizer& localizer) {
  return localizer.snapshot().calibrated_vehicle().empty() ? "fleet" : "vehicle";
}

}  // namespace

Json RunJson(const Localizer& localizer, const RunSummary& summary) {
  const LocalizerStatistics statistics = localizer.Statistics();
  const auto estimate = localizer.Estimate();
  Json document;
  document["area"] = localizer.snapshot().area();
  document["version"] = localizer.snapshot().version().value();
  document["vehicle"] = summary.vehicle;
  document["calibration"] = CalibrationOwner(localizer);
  document["frames"] = statistics.scans;
  document["frames_by_lidar"] = statistics.scans_by_lidar;
  document["state"] = ToString(localizer.state());
  document["states"] = StatesJson(statistics);
  document["gaps"] = {{"count", statistics.gaps}, {"seconds", statistics.gap_s}};
  document["state_changes"] = StateChangesJson(localizer);
  document["starts"] = statistics.starts;
  document["localized"] = statistics.localized();
  document["signatures"] = {{"seen", summary.signatures.size()},
                            {"known", summary.known_signatures}};
  document["decisions"] = DecisionsJson(localizer);
  document["mode_probabilities"] = ProbabilitiesJson(localizer);
  document["sightings"] = SightingsJson(localizer);
  document["latency_ms"] = {{"p50", LatencyMs(summary, 0.5)},
                            {"p99", LatencyMs(summary, 0.99)},
                            {"max", LatencyMs(summary, 1.0)}};
  document["nis"] = {{"mean", MeanNis(statistics)}, {"dof", 2}, {"count", statistics.updates}};
  document["leaves_max"] = statistics.leaves_max;
  document["dropped_mass_max"] = statistics.dropped_mass_max;
  document["not_counted"] = {{"duplicate_signature", statistics.duplicate_signatures},
                             {"unknown_signature", statistics.unknown_signatures},
                             {"anonymous", statistics.anonymous},
                             {"ungated", statistics.ungated},
                             {"implausible_observation", statistics.implausible_observations},
                             {"implausible_odometry", statistics.implausible_odometry},
                             {"excess_observation", statistics.excess_observations},
                             {"excess_place", statistics.excess_places},
                             {"late", statistics.late},
                             {"future", statistics.jumped}};
  document["truncated"] = !summary.truncation.empty();
  if (estimate) {
    document["quality"] = estimate->quality;
    const Se2& T_map_vehicle = estimate->pose.T_map_vehicle;
    document["T_map_vehicle"] = {T_map_vehicle.x(), T_map_vehicle.y(), T_map_vehicle.yaw()};
  }
  if (summary.hypotheses) document["hypotheses"] = HypothesisJson(*summary.hypotheses);
  if (!summary.report_uuid.empty()) document["report_uuid"] = summary.report_uuid;
  if (summary.returned) document["returned"] = ReturnedJson(*summary.returned);
  return document;
}

std::string RunText(const Localizer& localizer, const RunSummary& summary) {
  const LocalizerStatistics statistics = localizer.Statistics();
  std::string text = fmt::format(
      "area '{}' version {}, vehicle '{}' with the calibration of the {}: {} scans, {} decisions, "
      "{} "
      "sightings\n",
      InertLine(localizer.snapshot().area()),
      localizer.snapshot().version().value(),
      InertLine(summary.vehicle),
      CalibrationOwner(localizer),
      statistics.scans,
      localizer.decisions().size(),
      localizer.Sightings().size());
  for (std::size_t i = 0; i < kLocalizerStates; ++i) {
    if (statistics.seconds_in_state[i] == 0.0) continue;
    text += fmt::format("  {:<15} {:10.1f} s\n",
                        ToString(static_cast<LocalizerState>(i)),
                        statistics.seconds_in_state[i]);
  }
  text += fmt::format("NIS {:.2f} (2 expected), latency p99 {:.2f} ms, at most {} leaves\n",
                      MeanNis(statistics),
                      LatencyMs(summary, 0.99),
                      statistics.leaves_max);
  if (summary.returned) text += "returned " + ReturnedText(*summary.returned);
  return text;
}

}  // namespace shiftmap
