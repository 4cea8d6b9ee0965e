// SPDX-License-Identifier: Apache-2.0
#include "mapper/cli/build_report.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <string_view>

#include "mapstore/core/clock.h"
#include "mapstore/core/inert_text.h"

namespace shiftmap {
namespace {

Json RunJson(const MappedRun& run, const ImplausibleItems& dropped) {
  Json moved = Json::array();
  for (const Stamp stamp : run.moved) moved.push_back(ToSecondsSinceEpoch(stamp));
  return {{"run", run.name},
          {"poses", run.poses},
          {"observations", run.observations},
          {"outliers", run.outliers},
          {"duplicate_observations", run.duplicate_observations},
          {"near_observations", run.near_observations},
          {"anonymous_observations", run.anonymous_observations},
          {"implausible_observations", dropped.observations},
          {"implausible_odometry", dropped.odometry},
          {"chi2", run.chi2},
          {"variance_factor", run.variance_factor},
          {"moved_s", moved},
          {"T_map_start", {run.T_map_start.x(), run.T_map_start.y(), run.T_map_start.yaw()}},
          {"odometry",
           {{"scale_v", run.odometry.scale_v},
            {"scale_omega", run.odometry.scale_omega},
            {"lag_s", run.odometry.lag_s}}},
          {"sensor",
           {{"log_range_scale", run.sensor_bias[kLogRangeScale]},
            {"bearing_offset_rad", run.sensor_bias[kBearingOffset]},
            {"range_curvature_per_rad2", run.sensor_bias[kRangeCurvature]}}}};
}

// @param landmark  The group in the map.
Json ChainJson(const GroupChain& group, const LandmarkGroup& landmark) {
  Json chain = {{"signature", landmark.signature.text()},
                {"leave_rate_per_s", landmark.chain.leave_rate_per_s()},
                {"uniform", landmark.chain.uniform()},
                {"visits", group.chain.visits},
                {"learned", group.learned}};
  if (group.learned) {
    chain["interval_per_s"] = {group.chain.leave.low_per_s, group.chain.leave.high_per_s};
    chain["converged"] = group.chain.fit.converged;
    chain["rhythm_gain"] = group.rhythm_gain;
  }
  if (const ChainRhythm* const rhythm = landmark.chain.rhythm()) {
    chain["rhythm_s"] = ToSeconds(rhythm->calendar().period);
  }
  return chain;
}

Json SignaturesJson(const std::vector<Signature>& signatures) {
  Json names = Json::array();
  for (const Signature& signature : signatures) names.push_back(signature.text());
  return names;
}

Json AmbiguousChangeJson(std::size_t id, const AmbiguousChange& change) {
  Json runs = Json::array();
  for (const RunName& run : change.runs) runs.push_back(run.name);
  Json explanations = Json::array();
  for (const AmbiguousChange::Alternative& explanation : change.explanations) {
    explanations.push_back({{"stayed", SignaturesJson(explanation.stayed)},
                            {"moved", SignaturesJson(explanation.moved)},
                            {"probability", explanation.probability}});
  }
  Json document = {{"id", id},
                   {"state", change.waits ? "waiting" : "kept"},
                   {"runs", runs},
                   {"deciding", SignaturesJson(change.deciding)},
                   {"explanations", explanations}};
  if (change.misfit) {
    document["misfit"] = {{"stayed", SignaturesJson(change.misfit->stayed)},
                          {"chi2", change.misfit->chi2},
                          {"limit", change.misfit->limit},
                          {"degrees_of_freedom", change.misfit->degrees_of_freedom}};
  }
  return document;
}

// "12, 27 and 54", or how many they are.
std::string List(const std::vector<Signature>& signatures) {
  constexpr std::size_t kMaxNamed = 8;
  if (signatures.size() > kMaxNamed) return fmt::format("{} landmarks", signatures.size());
  std::string text;
  for (std::size_t i = 0; i < signatures.size(); ++i) {
    const bool last = i > 0 && i + 1 == signatures.size();
    text += i == 0 ? "" : last ? " and " : ", ";
    text += InertLine(signatures[i].text());
  }
  return text;
}

std::string Words(const AmbiguousChange::Alternative& explanation) {
  const std::string moved =
      explanation.moved.size() == 1 ? "1 moved" : fmt::format("{} moved", explanation.moved.size());
  const double percent = 100.0 * explanation.probability;
  if (explanation.stayed.empty()) {
    return fmt::format("at most one landmark stayed ({:.0f} %)", percent);
  }
  return fmt::format("{} stayed and {} ({:.0f} %)", List(explanation.stayed), moved, percent);
}

Json IntervalJson(const Interval& interval) {
  return {{"value", interval.value}, {"interval_95", {interval.low, interval.high}}};
}

// One line for each run that waits, or for each that does not.
std::vector<std::string> AmbiguousLines(const MapperResult& result,
                                        bool waits,
                                        std::string_view what) {
  std::vector<std::string> lines;
  for (const AmbiguousChange& change : result.ambiguous_changes) {
    if (change.waits != waits) continue;
    for (const RunName& run : change.runs) {
      lines.push_back(fmt::format("run '{}' {}: {}", run.name, what, WaitingReason(change)));
    }
  }
  return lines;
}

}  // namespace

std::string WaitingReason(const AmbiguousChange& change) {
  if (change.misfit) {
    return fmt::format(
        "with {} where the map has them it does not fit as it does by itself (chi-square {:.0f}, "
        "at most {:.0f} expected)",
        List(change.misfit->stayed),
        change.misfit->chi2,
        change.misfit->limit);
  }
  std::string text;
  for (std::size_t i = 0; i < change.explanations.size(); ++i) {
    text += i == 0 ? "either " : ", or ";
    text += Words(change.explanations[i]);
  }
  if (change.explanations.size() == 1) text = Words(change.explanations.front());
  if (!change.waits) text += fmt::format("; {} kept both places", List(change.deciding));
  if (!change.deciding.empty()) {
    text += fmt::format("; another run past {} may decide", List(change.deciding));
  }
  return text;
}

std::string WaitingReason(const UnplacedRun& run) {
  return fmt::format("since {} UTC; this build was not given its log", FormatUtc(run.since));
}

std::vector<std::string> WaitingLines(const MapperResult& result) {
  return AmbiguousLines(result, true, "waits");
}

std::vector<std::string> KeptLines(const MapperResult& result) {
  return AmbiguousLines(result, false, "is ambiguous");
}

std::vector<std::string> LeftOutLines(const MapperResult& result) {
  std::vector<std::string> lines;
  for (const RejectedRun& run : result.rejected) {
    lines.push_back(fmt::format("run '{}' is left out: {}", run.name, run.reason));
  }
  return lines;
}

Json VehiclesJson(const std::vector<VehicleEstimate>& vehicles) {
  Json document = Json::array();
  for (const VehicleEstimate& vehicle : vehicles) {
    document.push_back(
        {{"vehicle", vehicle.vehicle},
         {"runs", vehicle.runs},
         {"scale_v", IntervalJson(vehicle.scale_v)},
         {"scale_omega", IntervalJson(vehicle.scale_omega)},
         {"lag_s", IntervalJson(vehicle.lag_s)},
         {"noise_v", IntervalJson(vehicle.noise_v)},
         {"noise_omega", IntervalJson(vehicle.noise_omega)},
         {"range_scale", IntervalJson(vehicle.range_scale)},
         {"bearing_offset_rad", IntervalJson(vehicle.bearing_offset_rad)},
         {"range_curvature_per_rad2", IntervalJson(vehicle.range_curvature_per_rad2)},
         {"sd_range_m", IntervalJson(vehicle.sd_range_m)},
         {"sd_bearing_rad", IntervalJson(vehicle.sd_bearing_rad)},
         {"detection_probability", IntervalJson(vehicle.detection_probability)}});
  }
  return document;
}

Json BuildJson(const std::string& area,
               const MapperResult& result,
               const std::map<std::string, ImplausibleItems>& dropped,
               const std::vector<UnplacedRun>& not_given,
               const std::optional<CommitResult>& commit) {
  Json document = {{"area", area}};
  if (commit) {
    document["version"] = commit->version.value();
    document["content_hash"] = commit->content_hash;
  } else {
    document["content_hash"] = ContentHash(result.content);
  }
  document["runs"] = Json::array();
  for (const MappedRun& run : result.runs) {
    const auto of_run = dropped.find(run.sha256);
    document["runs"].push_back(
        RunJson(run, of_run == dropped.end() ? ImplausibleItems() : of_run->second));
  }
  document["rejected"] = Json::array();
  for (const RejectedRun& run : result.rejected) {
    document["rejected"].push_back({{"run", run.name}, {"reason", run.reason}});
  }
  document["ambiguous_changes"] = Json::array();
  document["waiting"] = Json::array();
  for (const AmbiguousChange& change : result.ambiguous_changes) {
    document["ambiguous_changes"].push_back(
        AmbiguousChangeJson(document["ambiguous_changes"].size() + 1, change));
    for (const RunName& run : change.runs) {
      if (!change.waits) continue;
      document["waiting"].push_back({{"run", run.name}, {"reason", WaitingReason(change)}});
    }
  }
  for (const UnplacedRun& run : not_given) {
    document["waiting"].push_back({{"run", run.name}, {"reason", WaitingReason(run)}});
  }
  std::size_t modes = 0;
  Json modes_per_group = Json::object();
  for (const LandmarkGroup& group : result.content.groups) {
    modes += group.modes.size();
    modes_per_group[group.signature.text()] = group.modes.size();
  }
  const OdometryCalibration& odometry = result.content.calibration.odometry;
  document["groups"] = result.content.groups.size();
  document["modes"] = modes;
  document["modes_per_group"] = modes_per_group;
  document["anonymous_landmarks"] = result.content.anonymous_landmarks.size();
  document["modes_created"] = result.modes_created;
  document["modes_merged"] = result.modes_merged;
  document["outer_iterations"] = result.outer_iterations;
  document["disagreement"] = result.disagreement;
  document["selection"] = {{"visits", result.selection.visits},
                           {"uncertain_visits", result.selection.uncertain_visits},
                           {"log_joint", result.selection.log_joint},
                           {"best_log_joint", result.selection.best_log_joint}};
  document["vehicles"] = VehiclesJson(result.vehicles);
  document["estimated_memory_mib"] =
      static_cast<double>(result.estimated_memory_bytes) / (1024.0 * 1024.0);
  document["chains"] = Json::array();
  for (std::size_t i = 0; i < result.chains.size(); ++i) {
    document["chains"].push_back(ChainJson(result.chains[i], result.content.groups[i]));
  }
  document["odometry_calibration"] = {{"scale_v", odometry.scale_v},
                                      {"scale_omega", odometry.scale_omega},
                                      {"lag_s", odometry.lag_s},
                                      {"noise_v", odometry.noise_v},
                                      {"noise_omega", odometry.noise_omega}};
  return document;
}

std::string BuildText(const MapperResult& result, const std::optional<CommitResult>& commit) {
  std::string text =
      commit
          ? fmt::format("version {}, content {}\n", commit->version.value(), commit->content_hash)
          : std::string("nothing written\n");
  std::size_t modes = 0;
  for (const LandmarkGroup& group : result.content.groups) modes += group.modes.size();
  const std::size_t anonymous = result.content.anonymous_landmarks.size();
  text +=
      fmt::format("{} landmarks, {} modes{}, {} of them new\n",
                  result.content.groups.size(),
                  modes,
                  anonymous > 0 ? fmt::format(" and {} places without a signature", anonymous) : "",
                  result.modes_created);
  for (const MappedRun& run : result.runs) {
    text += fmt::format("run {}: {} poses, {} observations, {} outliers\n",
                        InertLine(run.name),
                        run.poses,
                        run.observations,
                        run.outliers);
  }
  for (const VehicleEstimate& vehicle : result.vehicles) {
    text += fmt::format(
        "vehicle {}: scale {:.4f} ({:.4f} to {:.4f}), turn scale {:.4f} ({:.4f} to {:.4f}), lag "
        "{:.3f} s ({:.3f} to {:.3f})\n",
        vehicle.vehicle.empty() ? "without a name" : InertLine(vehicle.vehicle),
        vehicle.scale_v.value,
        vehicle.scale_v.low,
        vehicle.scale_v.high,
        vehicle.scale_omega.value,
        vehicle.scale_omega.low,
        vehicle.scale_omega.high,
        vehicle.lag_s.value,
        vehicle.lag_s.low,
        vehicle.lag_s.high);
  }
  return text;
}

}  // namespace shiftmap
