// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/check/check_command.h"

#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>

#include "mapstore/cli/input_options.h"
#include "mapstore/codec/run_log.h"
#include "mapstore/core/clock.h"
#include "mapstore/core/inert_text.h"
#include "tools/convert/check/log_check.h"

namespace shiftmap {
namespace {

struct CheckArguments {
  std::string log;
  LimitOptions limits;
  double clock_tolerance_s = kDefaultClockToleranceS;
};

// What was found of a log, and how much of it could be read.
struct Checked {
  RunInfo info;
  Findings findings;
};

// A damaged log is judged by what comes before the damage.
StatusOr<Checked> CheckLog(const std::string& path, LogCheck* check) {
  SHIFTMAP_ASSIGN_OR_RETURN(RunLogStream stream, RunLogStream::Open(path));
  std::optional<Finding> damage;
  for (;;) {
    const StatusOr<std::optional<RunEvent>> event = stream.Next();
    if (!event.ok()) {
      if (event.status().code() == StatusCode::kUnavailable) return event.status();
      damage = {Severity::kError,
                "unreadable",
                "log",
                Message(event.status()),
                "write the log as proto/FORMATS.md says; a number must be finite"};
      break;
    }
    if (!event->has_value()) break;
    check->Add(**event);
  }
  if (!damage && !stream.truncation().empty()) {
    damage = {Severity::kWarning,
              "truncated",
              "log",
              stream.truncation(),
              "what comes before is good; see why the recorder was killed"};
  }
  Checked checked{stream.info(), check->Finish(stream.info())};
  if (damage) checked.findings.insert(checked.findings.begin(), *damage);
  return checked;
}

Json RateOf(const TimeCheck& times) {
  Json document = {{"count", times.count()}};
  const auto interval_s = times.MedianInterval();
  if (interval_s && *interval_s > 0.0) document["rate_hz"] = 1.0 / *interval_s;
  document["longest_gap_s"] = times.LongestInterval();
  return document;
}

double SecondsOf(const LogCheck& check) {
  const TimeCheck& times = check.odometry_times();
  return times.count() == 0 ? 0.0 : ToSeconds(times.end() - times.begin());
}

Json DocumentOf(const std::string& path, const LogCheck& check, const Checked& checked) {
  Json findings = Json::array();
  for (const Finding& finding : checked.findings) {
    findings.push_back({{"severity", SeverityName(finding.severity)},
                        {"code", finding.code},
                        {"place", finding.place},
                        {"message", finding.message},
                        {"advice", finding.advice}});
  }
  const ScanCheck& scans = check.scans();
  Json document = {{"log", path},
                   {"vehicle", checked.info.vehicle},
                   {"source", checked.info.source},
                   {"area", checked.info.area},
                   {"run_uuid", checked.info.uuid},
                   {"duration_s", SecondsOf(check)},
                   {"odometry", RateOf(check.odometry_times())},
                   {"scans", RateOf(check.scan_times())},
                   {"lidar_scans", check.lidar_scans()},
                   {"observations", scans.observations()},
                   {"empty_scans", scans.empty_scans()},
                   {"signatures", scans.signatures()},
                   {"seen_once", scans.seen_once()},
                   {"without_signature", scans.anonymous()},
                   {"max_speed_mps", check.odometry().max_speed_mps()},
                   {"max_yaw_rate_radps", check.odometry().max_yaw_rate_radps()},
                   {"motion_pairs", check.motion().pairs()},
                   {"findings", findings}};
  if (check.odometry_times().count() > 0) {
    document["begin_s"] = ToSecondsSinceEpoch(check.odometry_times().begin());
  }
  const auto misfit = check.motion().MedianMisfit();
  if (misfit) document["motion_misfit"] = *misfit;
  const auto lag = check.lag().Lag();
  document["lag_s"] = lag ? Json(*lag) : Json(nullptr);
  return document;
}

std::string RateText(const TimeCheck& times) {
  const auto interval_s = times.MedianInterval();
  if (!interval_s || *interval_s <= 0.0) return fmt::format("{}", times.count());
  return fmt::format("{}, {:.1f} Hz", times.count(), 1.0 / *interval_s);
}

std::string TextOf(const std::string& path, const LogCheck& check, const Checked& checked) {
  const ScanCheck& scans = check.scans();
  std::string text = fmt::format("{}: vehicle '{}', area '{}', {:.1f} s\n",
                                 path,
                                 InertLine(checked.info.vehicle),
                                 InertLine(checked.info.area),
                                 SecondsOf(check));
  text += fmt::format("odometry      {}\n", RateText(check.odometry_times()));
  text += fmt::format(
      "scans         {}, {} of them empty\n", RateText(check.scan_times()), scans.empty_scans());
  text += fmt::format("observations  {} of {} signatures, {} without signature\n",
                      scans.observations(),
                      scans.signatures(),
                      scans.anonymous());
  if (checked.findings.empty()) return text + "nothing is wrong\n";
  for (const Finding& finding : checked.findings) {
    text += fmt::format("\n{}: {} ({})\n  {}\n  do: {}\n",
                        SeverityName(finding.severity),
                        finding.code,
                        finding.place,
                        finding.message,
                        finding.advice);
  }
  return text;
}

Status RunCheck(const CheckArguments& arguments, Context& context) {
  LogCheckOptions options;
  options.limits = arguments.limits.For({});
  options.now = SystemNow();
  options.clock_tolerance_s = arguments.clock_tolerance_s;
  SHIFTMAP_RETURN_IF_ERROR(arguments.limits.Validate());
  LogCheck check(options);
  SHIFTMAP_ASSIGN_OR_RETURN(const Checked checked, CheckLog(arguments.log, &check));
  context.Report(DocumentOf(arguments.log, check, checked), TextOf(arguments.log, check, checked));
  const auto count = [&](Severity severity) {
    return std::count_if(checked.findings.begin(),
                         checked.findings.end(),
                         [&](const Finding& finding) { return finding.severity == severity; });
  };
  if (count(Severity::kError) > 0) {
    return InvalidArgument("run log '{}': no map can be made of it: {}",
                           arguments.log,
                           checked.findings.front().message);
  }
  if (const auto warnings = count(Severity::kWarning); warnings > 0) {
    context.Attend(fmt::format("run log '{}': warnings: {}", arguments.log, warnings));
  }
  return OkStatus();
}

}  // namespace

void AddCheckCommand(Application* application) {
  auto arguments = std::make_shared<CheckArguments>();
  Command& command = application->AddCommand(
      "check",
      "Look for mistakes in a run log, before a map is made of it",
      [arguments](Context& context) { return RunCheck(*arguments, context); });
  command.Option("LOG", &arguments->log, "Run log, or - for standard input").Required();
  AddLimitOptions(&arguments->limits, &command);
  AddClockToleranceOption(&arguments->clock_tolerance_s, &command);
}

}  // namespace shiftmap
