// SPDX-License-Identifier: Apache-2.0
//
// `return` and `upload`: files that a person names.
#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "localizer/transfer/backoff.h"
#include "localizer/transfer/cli/signal_stop.h"
#include "localizer/transfer/cli/transfer_bodies.h"
#include "localizer/transfer/log_upload.h"
#include "localizer/transfer/map_client.h"
#include "mapstore/codec/shift_report.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/core/input_file.h"

namespace shiftmap::transfer {
namespace {

// What became of several files: the gravest of it is the command's own status.
class Outcomes {
 public:
  void Add(Json entry, const std::string& text) {
    list_.push_back(std::move(entry));
    text_ += text;
  }

  // True if the next file would fare no better.
  bool Failed(Json entry, const std::string& path, const Status& status) {
    entry["error"] = Message(status);
    // Standard error has the reason of the gravest.
    Add(std::move(entry), fmt::format("{}: not handed in\n", InertLine(path)));
    const bool temporary = IsTemporary(status);
    if (failure_.ok() || temporary) failure_ = status;
    return temporary || status.code() == StatusCode::kUnauthenticated;
  }

  void Known() { ++known_; }

  // Whether a signal came. What is handed in stays so, and what is not goes on from where it was.
  bool Stopped(const char* command, const std::string& server, std::size_t files) {
    const Status stopped = StopSignals::Check(
        fmt::format("server '{}': {}", server, command),
        fmt::format("{} of {} files are done, the same command goes on", list_.size(), files));
    if (stopped.ok()) return false;
    failure_ = stopped;
    return true;
  }

  Status Report(const char* key, const std::string& server, std::size_t files, Context* context) {
    const std::size_t done = list_.size();
    context->Report({{key, std::move(list_)}}, text_);
    SHIFTMAP_RETURN_IF_ERROR(failure_);
    if (known_ < files || done < files) return OkStatus();
    return MakeStatus(StatusCode::kAlreadyExists, "server '{}': it has every file already", server);
  }

 private:
  Json list_ = Json::array();
  std::string text_;
  std::size_t known_ = 0;
  Status failure_ = OkStatus();
};

StatusOr<SubmitResult> Submit(MapClient* client, const std::string& bytes, double give_up_s) {
  BackoffOptions options;
  options.give_up_s = give_up_s;
  Backoff backoff(options, RandomSeed());
  for (;;) {
    StatusOr<SubmitResult> result = client->SubmitReport(bytes);
    if (result.ok() || !backoff.Again(result.status(), client->stop())) return result;
  }
}

Json SetAsideJson(const SubmitResult& result) {
  Json list = Json::array();
  for (const SubmitResult::SetAside& entry : result.set_aside) {
    list.push_back({{"reason", entry.reason}, {"rows", entry.rows}});
  }
  return list;
}

std::string ReturnText(const std::string& path, const SubmitResult& result) {
  std::string text =
      fmt::format("{}: {}\n",
                  InertLine(path),
                  result.duplicate ? std::string("known already")
                                   : fmt::format("{} evidence rows", result.evidence_rows));
  for (const SubmitResult::SetAside& entry : result.set_aside) {
    text += fmt::format("  {} of them kept aside: {}\n", entry.rows, InertLine(entry.reason));
  }
  return text;
}

}  // namespace

Status RunReturn(const ReturnArguments& arguments, Context& context) {
  const SignalStop stop;
  // All are read before the first is returned: a bad file changes nothing.
  std::vector<ShiftReport> reports;
  for (const std::string& path : arguments.reports) {
    SHIFTMAP_ASSIGN_OR_RETURN(ShiftReport report, ReadShiftReport(path));
    reports.push_back(std::move(report));
  }
  const std::string& server = arguments.server.server;
  SHIFTMAP_ASSIGN_OR_RETURN(MapClient client,
                            MapClient::Create(ServerOptionsOf(arguments.server), stop.token()));
  Outcomes outcomes;
  for (std::size_t i = 0; i < reports.size() && !context.dry_run(); ++i) {
    if (outcomes.Stopped("return", server, reports.size())) break;
    const std::string& path = arguments.reports[i];
    Json entry{{"report", path}, {"uuid", reports[i].uuid}};
    const StatusOr<SubmitResult> result =
        Submit(&client, EncodeShiftReport(reports[i]), arguments.server.give_up_s);
    if (!result.ok()) {
      if (outcomes.Stopped("return", server, reports.size())) break;
      const Status status = Annotate(result.status(), "shift report '{}'", path);
      if (outcomes.Failed(std::move(entry), path, status)) break;
      continue;
    }
    if (result->duplicate) outcomes.Known();
    entry["duplicate"] = result->duplicate;
    entry["evidence_rows"] = result->evidence_rows;
    entry["set_aside"] = SetAsideJson(*result);
    outcomes.Add(std::move(entry), ReturnText(path, *result));
  }
  return outcomes.Report("reports", server, arguments.reports.size(), &context);
}

Status RunUpload(const UploadArguments& arguments, Context& context) {
  const SignalStop stop;
  const std::string& server = arguments.server.server;
  for (const std::string& path : arguments.logs) {
    const StatusOr<std::ifstream> file = OpenInputFile(path);
    SHIFTMAP_RETURN_IF_ERROR(Annotate(file.status(), "run log '{}'", path));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(MapClient client,
                            MapClient::Create(ServerOptionsOf(arguments.server), stop.token()));
  UploadOptions options;
  options.backoff.give_up_s = arguments.server.give_up_s;
  options.max_bytes_per_s = 1024.0 * arguments.server.max_kib_per_s;
  const std::unique_ptr<Progress> progress = context.MakeProgress();
  Outcomes outcomes;
  for (std::size_t i = 0; i < arguments.logs.size() && !context.dry_run(); ++i) {
    if (outcomes.Stopped("upload", server, arguments.logs.size())) break;
    const std::string& path = arguments.logs[i];
    options.progress = [&](double done) {
      const auto before = static_cast<double>(i);
      progress->Update("uploading", (before + done) / static_cast<double>(arguments.logs.size()));
    };
    const StatusOr<UploadResult> result = UploadLog(&client, path, options);
    if (!result.ok()) {
      if (outcomes.Stopped("upload", server, arguments.logs.size())) break;
      if (outcomes.Failed({{"log", path}}, path, result.status())) break;
      continue;
    }
    if (result->known_already) outcomes.Known();
    outcomes.Add({{"log", path},
                  {"sha256", result->sha256},
                  {"size_bytes", result->size_bytes},
                  {"sent_bytes", result->sent_bytes},
                  {"duplicate", result->known_already},
                  {"retries", result->retries}},
                 fmt::format("{}: {}\n",
                             InertLine(path),
                             result->known_already ? std::string("known already")
                                                   : fmt::format("{} bytes", result->size_bytes)));
  }
  return outcomes.Report("logs", server, arguments.logs.size(), &context);
}

}  // namespace shiftmap::transfer
