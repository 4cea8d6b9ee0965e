// SPDX-License-Identifier: Apache-2.0
#include "mapper/cli/build_warnings.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <utility>

#include "mapper/cli/build_report.h"
#include "mapper/frontend/mapping_run.h"
#include "mapstore/core/inert_text.h"

namespace shiftmap {
namespace {

// Share of a run's observations from which on somebody has to see to them. Sensors that work have a
// few in a hundred.
constexpr double kMostOutliers = 0.1;

}  // namespace

std::vector<std::string> AtTwoPlaces(const std::vector<MapperInput>& inputs,
                                     const std::vector<LineRun>& known_runs) {
  struct Stay {
    const std::string& vehicle;
    const std::string& run;
    Stamp begin;
    Stamp end;
  };
  std::vector<Stay> stays;
  for (const MapperInput& input : inputs) {
    if (input.run.odometry.empty()) continue;
    stays.push_back({input.run.info.vehicle, input.name, BeginOf(input.run), EndOf(input.run)});
  }
  const std::size_t of_build = stays.size();
  for (const auto& [run, version, committed] : known_runs) {
    stays.push_back({run.vehicle, run.name, run.begin, run.end});
  }
  std::map<std::string, std::string> lines;
  for (std::size_t i = 0; i < of_build; ++i) {
    const Stay& a = stays[i];
    for (std::size_t k = i + 1; k < stays.size() && !a.vehicle.empty(); ++k) {
      const Stay& b = stays[k];
      if (a.vehicle != b.vehicle || a.begin >= b.end || b.begin >= a.end) continue;
      lines.try_emplace(a.vehicle,
                        fmt::format("vehicle '{}' is in runs '{}' and '{}' at {} UTC: a clock is "
                                    "wrong, or two vehicles have one name",
                                    a.vehicle,
                                    a.run,
                                    b.run,
                                    FormatUtc(std::max(a.begin, b.begin))));
    }
  }
  std::vector<std::string> result;
  for (auto& [vehicle, line] : lines) result.push_back(std::move(line));
  return result;
}

void WarnOfMoving(const std::vector<MapperInput>& inputs,
                  const FrontEndOptions& options,
                  const Context& context) {
  for (const MapperInput& input : inputs) {
    for (const auto& [signature, count] : MovingSightings(input.run, options)) {
      context.Warn(
          fmt::format("run '{}': landmark '{}' moves while it is in view, as a code on a vehicle: "
                      "{} sightings are left out",
                      input.name,
                      InertLine(signature.text()),
                      count));
    }
  }
}

void WarnOfOdd(const MapperResult& result, const Context& context) {
  for (const MappedRun& run : result.runs) {
    for (const Stamp stamp : run.moved) {
      context.Warn(
          fmt::format("run '{}': after {} UTC the vehicle was moved and its odometry did not "
                      "see it: it was carried or towed, or the recorder paused",
                      run.name,
                      FormatUtc(stamp)));
    }
    if (run.anonymous_observations > 0) {
      context.Inform(fmt::format("run '{}': {} observations without a signature are left out",
                                 run.name,
                                 run.anonymous_observations));
    }
    if (run.duplicate_observations > 0) {
      context.Warn(fmt::format(
          "run '{}': {} observations of a signature at two places in one scan are left out",
          run.name,
          run.duplicate_observations));
    }
    if (run.outliers > kMostOutliers * run.observations) {
      context.Warn(
          fmt::format("run '{}': {} of {} observations are not where the map has their landmark, "
                      "or cannot be confirmed: signatures are misread, or landmarks move while "
                      "they are in view",
                      run.name,
                      run.outliers,
                      run.observations));
    }
  }
}

void WarnOfRuns(const AreaBuild& build, Context& context) {
  for (const std::string& line : WaitingLines(build.result)) context.Attend(line);
  for (const std::string& line : KeptLines(build.result)) context.Warn(line);
  for (const std::string& run : build.fallen_out) {
    context.Attend(fmt::format(
        "run '{}' is no longer in the map: its version is no prior; build its log again", run));
  }
  for (const std::string& line : build.objections) context.Attend(line);
  for (const std::string& line : build.at_two_places) context.Warn(line);
  for (const UnplacedRun& run : build.not_given) {
    context.Warn(fmt::format("run '{}' waits {}", run.name, WaitingReason(run)));
  }
  for (const std::string& line : LeftOutLines(build.result)) context.Warn(line);
}

}  // namespace shiftmap
