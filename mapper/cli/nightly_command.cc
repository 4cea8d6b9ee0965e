// SPDX-License-Identifier: Apache-2.0
//
// The night of a fleet: what its vehicles brought back goes into the maps.
#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "mapper/cli/commands.h"
#include "mapper/nightly/log_limits.h"
#include "mapper/nightly/night.h"
#include "mapper/nightly/night_json.h"
#include "mapper/nightly/night_page.h"
#include "mapper/nightly/night_plan.h"
#include "mapstore/cli/exit_codes.h"
#include "mapstore/cli/stop_signals.h"
#include "mapstore/core/inert_text.h"

namespace shiftmap {
namespace {

struct NightlyArguments {
  std::string phase = "all";
  std::optional<std::string> output;
  std::optional<std::string> plan;
  std::optional<std::int64_t> index;
  std::optional<std::string> scratch;
  NightOptions night;
};

// What is wrong with the options as a whole; empty if nothing is.
std::string CheckArguments(const NightlyArguments& arguments) {
  const bool needs_fleet = arguments.phase == "all" || arguments.phase == "plan";
  if (needs_fleet && arguments.night.build.store.empty()) return "--store is required";
  if (needs_fleet && arguments.night.logs.empty()) return "--logs is required";
  if (arguments.phase == "plan" && !arguments.output) return "plan: --output is required";
  if (!needs_fleet && !arguments.plan) return arguments.phase + ": --plan is required";
  if (arguments.phase == "run" && !arguments.index) return "run: --index is required";
  return "";
}

void AttendTo(const Json& document, Context* context) {
  for (const Json& line : document["left"]) context->Attend(line.get<std::string>());
  for (const Json& area : document["areas"]) {
    for (const Json& reason : area["reasons"]) {
      context->Attend(
          fmt::format("area '{}': {}", area["area"].get<std::string>(), reason.get<std::string>()));
    }
  }
}

// `2026-01-09T060000Z`: the name of a night's files.
std::string NightTitle(Stamp begin) {
  std::string title = FormatUtc(begin);
  std::erase(title, ':');
  std::replace(title.begin(), title.end(), ' ', 'T');
  return title + "Z";
}

// A night under way: nothing of a dry run.
struct Night {
  Stamp begin;
  std::optional<NightLock> lock;
  std::vector<std::string> unreported;  // Of nights that were interrupted before it.
};

StatusOr<Night> Begin(const NightOptions& options, Context& context) {
  Night night;
  night.begin = SystemNow();
  if (context.dry_run()) return night;
  SHIFTMAP_ASSIGN_OR_RETURN(night.lock, NightLock::Take(options.build.store));
  SHIFTMAP_ASSIGN_OR_RETURN(night.unreported,
                            BeginNight(options, night.begin, context, &*night.lock));
  return night;
}

// Says what the night did; nothing to do is no report. It is done, with its page or without: to try
// again would find nothing new.
Status Finish(const NightOptions& options,
              const Json& document,
              const std::string& text,
              Night* night,
              Context* context) {
  AttendTo(document, context);
  const bool published =
      std::any_of(document["areas"].begin(), document["areas"].end(), [](const Json& area) {
        return area["published"].get<bool>();
      });
  const bool anything = published || document["reports"]["new"].get<int>() > 0 ||
                        document["logs_deleted"].get<int>() > 0 ||
                        context->done_code() != ExitCode::kDone;
  if (options.report && anything && !context->dry_run()) {
    const Status written =
        WriteNightReport(document, NightTitle(night->begin), options.build.store, *options.report);
    if (!written.ok()) context->Attend(Message(written) + ": the night is done, without its page");
  }
  if (night->lock) night->lock->End();
  context->Report(document, text);
  if (anything || context->dry_run()) return OkStatus();
  return MakeStatus(StatusCode::kAlreadyExists,
                    "map store '{}': nothing new in '{}'",
                    options.build.store,
                    options.logs);
}

Status RunAll(const NightOptions& options, Context& context) {
  SHIFTMAP_RETURN_IF_ERROR(MapStore::CheckWritable(options.build.store, context.dry_run()));
  SHIFTMAP_ASSIGN_OR_RETURN(Night night, Begin(options, context));
  SHIFTMAP_ASSIGN_OR_RETURN(NightResult result, RunNight(options, context));
  result.work.left.insert(
      result.work.left.begin(), night.unreported.begin(), night.unreported.end());
  return Finish(options, NightJson(result), NightText(result), &night, &context);
}

Status RunPlan(const NightlyArguments& arguments, Context& context) {
  const NightOptions& options = arguments.night;
  std::optional<NightLock> lock;
  SHIFTMAP_RETURN_IF_ERROR(MapStore::CheckWritable(options.build.store, context.dry_run()));
  if (!context.dry_run()) {
    SHIFTMAP_ASSIGN_OR_RETURN(lock, NightLock::Take(options.build.store));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const NightPlan plan, PlanNight(options, *arguments.output, context));
  Json areas = Json::array();
  std::string text = fmt::format("{} areas\n", plan.areas.size());
  for (std::size_t i = 0; i < plan.areas.size(); ++i) {
    areas.push_back({{"index", i},
                     {"area", plan.areas[i].area},
                     {"runs_new", plan.areas[i].logs.fresh.size()}});
    text += fmt::format(
        "{}: {}, {} new runs\n", i, InertLine(plan.areas[i].area), plan.areas[i].logs.fresh.size());
  }
  context.Report({{"plan", *arguments.output}, {"areas", areas}, {"left", plan.left}}, text);
  return OkStatus();
}

Status RunOne(const NightlyArguments& arguments, Context& context) {
  std::error_code error;
  const std::string scratch =
      arguments.scratch.value_or(std::filesystem::temp_directory_path(error).string());
  SHIFTMAP_ASSIGN_OR_RETURN(
      const AreaNight night,
      RunPlanned(arguments.night, *arguments.plan, *arguments.index, scratch, context));
  NightResult result;
  result.areas.push_back(night);
  context.Report(AreaNightJson(night), NightText(result));
  return OkStatus();
}

Status RunCollect(const NightlyArguments& arguments, Context& context) {
  NightOptions options = arguments.night;
  SHIFTMAP_ASSIGN_OR_RETURN(const NightPlan plan, ReadPlan(*arguments.plan));
  options.build.store = plan.store;
  options.logs = plan.logs;
  SHIFTMAP_ASSIGN_OR_RETURN(Night night, Begin(options, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<CollectedArea> collected,
                            CollectNight(plan, *arguments.plan, context));
  NightWork work;
  work.left = night.unreported;
  work.left.insert(work.left.end(), plan.left.begin(), plan.left.end());
  work.ignored = plan.ignored;
  Json areas = Json::array();
  for (std::size_t i = 0; i < collected.size(); ++i) {
    const CollectedArea& area = collected[i];
    work.areas[area.area] = plan.areas[i].logs;
    if (area.problem.empty()) {
      areas.push_back(area.document);
    } else {
      work.left.push_back(fmt::format("area '{}': {}", area.area, area.problem));
    }
  }
  std::vector<std::string> deleted;
  std::vector<std::string> to_delete;
  SHIFTMAP_ASSIGN_OR_RETURN((context.dry_run() ? to_delete : deleted),
                            KeepLogLimits(options, context, &work));
  const Json document = {{"areas", areas},
                         {"reports", {{"new", plan.reports_new}, {"known", plan.reports_known}}},
                         {"left", work.left},
                         {"logs_deleted", deleted.size()},
                         {"logs_to_delete", to_delete}};
  return Finish(options,
                document,
                fmt::format("{} of {} areas collected\n", areas.size(), collected.size()),
                &night,
                &context);
}

Status Nightly(const NightlyArguments& arguments, Context& context) {
  const StopSignals signals;
  if (arguments.phase == "plan") return RunPlan(arguments, context);
  if (arguments.phase == "run") return RunOne(arguments, context);
  if (arguments.phase == "collect") return RunCollect(arguments, context);
  return RunAll(arguments.night, context);
}

void AddJudgeOptions(NightOptions* night, Command* command) {
  command
      ->Option("--hold-out",
               &night->hold_out_percent,
               "Percentage of new runs that a build does not take, so that they judge it; the next "
               "night maps them")
      .InRange(0, 50)
      .Option("--judge-shifts",
              &night->judge.max_shifts,
              "Shifts of earlier days that are replayed on the old and the new map, and as many of "
              "the night's")
      .InRange(1, 1000)
      .Option("--judge-folds",
              &night->judge.max_folds,
              "Builds without a part of the runs, which judge it where no other shifts are there; "
              "below 2 none")
      .InRange(0, 10)
      .Flag("--no-judge", &night->no_judge, "Publish what was built, whatever it is worth");
}

void AddFolderOptions(NightOptions* night, Command* command) {
  command
      ->Option("--min-age-s",
               &night->min_age_s,
               "Leave a log that was written since for another night: it may not be whole")
      .InRange(0.0, 1e9)
      .Option("--log-quota-mib",
              &night->log_quota_mib,
              "Delete the oldest mapped logs until the folder's logs take no more")
      .InRange(0.0, 1e9)
      .Option("--log-max-age-days", &night->log_max_age_days, "Delete mapped logs that are older")
      .InRange(0.0, 1e6)
      .Option("--report", &night->report, "Folder for a JSON and an HTML page of each night");
}

void AddBuildOptions(AreaBuildOptions* build, Command* command) {
  command
      ->Flag("--no-learned-rates",
             &build->no_learned_rates,
             "Leave the rates of known landmarks' mode chains as they are")
      .Option("--threads",
              &build->threads,
              "Threads of a build, by default as many as the machine runs; the map is the same")
      .InRange(1, 256)
      .Option("--max-memory-mib",
              &build->max_memory_mib,
              "Leave out the largest logs of a build that would take more; by default, than this "
              "process can have")
      .InRange(1.0, 1e9);
}

}  // namespace

void AddNightlyCommand(Application* application) {
  auto arguments = std::make_shared<NightlyArguments>();
  NightOptions& night = arguments->night;
  Command& command = application->AddCommand(
      "nightly",
      "Return the reports and map the runs that a fleet left in a folder",
      [arguments](Context& context) { return Nightly(*arguments, context); });
  AddLimitOptions(&night.build.limits, &command);
  AddClockToleranceOption(&night.build.clock_tolerance_s, &command);
  command
      .Option(
          "PHASE",
          &arguments->phase,
          "The whole night, or for several machines: plan it, run one area, collect the results")
      .OneOf({"all", "plan", "run", "collect"})
      .Option("--store", &night.build.store, "Map store; made if there is none")
      .Option("--logs", &night.logs, "Folder with run logs and shift reports, and its subfolders")
      .Option("--area",
              &night.area,
              "Only this area, which is that of logs that name none; by default all, and such logs "
              "are of the only one there is, or of the one whose map they fit. The site file's key "
              "`area` counts in [nightly] alone");
  AddFolderOptions(&night, &command);
  AddJudgeOptions(&night, &command);
  AddBuildOptions(&night.build, &command);
  command
      .Option("--output", &arguments->output, "plan: file to write, and what runs need beside it")
      .Output()
      .Option("--plan", &arguments->plan, "run, collect: file that plan wrote")
      .Option("--index", &arguments->index, "run: area of the plan, from 0")
      .InRange(0, 1e6)
      .Option("--scratch", &arguments->scratch, "run: folder on a local disk (default: TMPDIR)")
      .Check([arguments] { return CheckArguments(*arguments); })
      .Writes();
}

}  // namespace shiftmap
