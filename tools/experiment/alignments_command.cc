// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/alignments_command.h"

#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "mapstore/map/estimate.h"
#include "tools/experiment/alignments.h"
#include "tools/experiment/experiment_output.h"

namespace shiftmap {
namespace {

constexpr double kNotApplicable = std::numeric_limits<double>::quiet_NaN();

struct Arguments {
  std::string output;
  std::vector<std::string> worlds;
  int pairs = 10000;
  int threads = 2;
  std::uint64_t seed = 1;
};

// Pairs that have something in common.
struct Part {
  std::string by;  // What they are told apart by.
  std::string name;
  std::vector<AlignmentOutcome> outcomes;
};

std::vector<std::string> WorldNames() {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < kAlignmentWorlds; ++i) {
    names.emplace_back(ToString(static_cast<AlignmentWorld>(i)));
  }
  return names;
}

std::vector<AlignmentWorld> WorldsOf(const Arguments& arguments) {
  const std::vector<std::string>& only = arguments.worlds;
  std::vector<AlignmentWorld> worlds;
  for (std::size_t i = 0; i < kAlignmentWorlds; ++i) {
    const auto world = static_cast<AlignmentWorld>(i);
    const bool named = std::find(only.begin(), only.end(), ToString(world)) != only.end();
    if (only.empty() || named) worlds.push_back(world);
  }
  return worlds;
}

Part Select(const std::string& by,
            const std::string& name,
            const std::vector<AlignmentOutcome>& all,
            const std::function<bool(const AlignmentOutcome&)>& is_in) {
  Part part{by, name, {}};
  std::copy_if(all.begin(), all.end(), std::back_inserter(part.outcomes), is_in);
  return part;
}

std::vector<Part> ByWorld(const std::vector<AlignmentWorld>& worlds,
                          const std::vector<AlignmentOutcome>& all) {
  std::vector<Part> parts = {{"all", "all", all}};
  for (const AlignmentWorld world : worlds) {
    parts.push_back(Select("world", ToString(world), all, [&](const AlignmentOutcome& outcome) {
      return outcome.world == world;
    }));
  }
  return parts;
}

void AddBySurvivors(const std::vector<AlignmentOutcome>& all, std::vector<Part>* parts) {
  struct Range {
    const char* name;
    int least;
    int most;
  };
  constexpr Range kRanges[] = {
      {"0-1", 0, 1}, {"2", 2, 2}, {"3", 3, 3}, {"4", 4, 4}, {"5-6", 5, 6}, {"7+", 7, 64}};
  for (const Range& range : kRanges) {
    parts->push_back(Select("stayed", range.name, all, [&](const AlignmentOutcome& outcome) {
      return outcome.stayed >= range.least && outcome.stayed <= range.most;
    }));
  }
}

// Of `count` of so many, in rounding no less than nothing.
Interval ShareOf(double count, double of) {
  Interval share = IntervalOf(ShareEstimate{count / of, of});
  share.low = std::max(0.0, share.low);
  return share;
}

ResultTable DecisionTable(const std::vector<Part>& parts) {
  ResultTable table({"by",
                     "part",
                     "method",
                     "pairs",
                     "decided",
                     "wrong",
                     "wrong_share",
                     "wrong_low",
                     "wrong_high",
                     "waiting_share",
                     "right_share",
                     "median_ms",
                     "log_score",
                     "right_among_kept"});
  for (const Part& part : parts) {
    if (part.outcomes.empty()) continue;
    const PosteriorTally posterior = TallyPosterior(part.outcomes);
    for (std::size_t i = 0; i < kAlignmentMethods; ++i) {
      const auto method = static_cast<AlignmentMethod>(i);
      const AlignmentTally tally = TallyOf(method, part.outcomes);
      const bool is_posterior = method == AlignmentMethod::kPosterior;
      const Interval wrong = ShareOf(tally.wrong, tally.decided);
      table.AddRow({part.by,
                    part.name,
                    std::string(ToString(method)),
                    tally.pairs,
                    tally.decided,
                    tally.wrong,
                    wrong.value,
                    wrong.low,
                    wrong.high,
                    1.0 - tally.decided / tally.pairs,
                    (tally.decided - tally.wrong) / tally.pairs,
                    1e3 * tally.median_s,
                    is_posterior ? posterior.log_score : kNotApplicable,
                    is_posterior ? posterior.among_kept / posterior.waiting : kNotApplicable});
    }
  }
  return table;
}

ResultTable CalibrationTable(const std::vector<Part>& parts) {
  ResultTable table(
      {"by", "part", "from", "pairs", "expected_share", "right_share", "right_low", "right_high"});
  for (const Part& part : parts) {
    for (const CalibrationBin& bin : Calibrate(part.outcomes)) {
      if (bin.pairs == 0.0) continue;
      const Interval right = ShareOf(bin.right, bin.pairs);
      table.AddRow({part.by,
                    part.name,
                    bin.low,
                    bin.pairs,
                    bin.expected / bin.pairs,
                    right.value,
                    right.low,
                    right.high});
    }
  }
  return table;
}

Status RunAlignments(const Arguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("alignments", arguments.output, context.dry_run()));
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput calibration,
      ExperimentOutput::Create("alignments-calibration", arguments.output, context.dry_run()));
  const std::unique_ptr<Progress> progress = context.MakeProgress();
  const std::vector<AlignmentWorld> worlds = WorldsOf(arguments);
  const auto count = static_cast<int>(worlds.size());
  std::vector<AlignmentOutcome> all;
  for (int i = 0; i < count; ++i) {
    const AlignmentWorld world = worlds[static_cast<std::size_t>(i)];
    progress->Update(ToString(world), static_cast<double>(i) / count);
    const int pairs = arguments.pairs / count + (i < arguments.pairs % count ? 1 : 0);
    const std::vector<AlignmentOutcome> outcomes =
        AlignPairs(world, arguments.seed, pairs, arguments.threads);
    all.insert(all.end(), outcomes.begin(), outcomes.end());
  }
  std::vector<Part> parts = ByWorld(worlds, all);
  AddBySurvivors(all, &parts);
  const ResultTable decisions = DecisionTable(parts);
  const ResultTable bins = CalibrationTable(parts);
  const Json options{
      {"seed", arguments.seed}, {"pairs", arguments.pairs}, {"worlds", arguments.worlds}};
  return output.ReportBoth(options, decisions, bins, &calibration, &context);
}

}  // namespace

void AddAlignmentsExperiment(Application* application) {
  auto arguments = std::make_shared<Arguments>();
  application
      ->AddCommand("alignments",
                   "Alignment of simulated maps with moved landmarks: how often it is right",
                   [arguments](Context& context) { return RunAlignments(*arguments, context); })
      .Option("--output", &arguments->output, "Folder for CSV and JSON")
      .Required()
      .Option("--pairs", &arguments->pairs, "Pairs of maps, over all worlds")
      .InRange(1, 10000000)
      .Option("--worlds", &arguments->worlds, "Only these ways in which landmarks move")
      .OneOf(WorldNames())
      .Option("--threads", &arguments->threads, "Threads; the results do not depend on it")
      .InRange(1, 64)
      .Option("--seed", &arguments->seed, "Seed of the first pair of each world")
      .Writes();
}

}  // namespace shiftmap
