// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/hand_in.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "mapstore/codec/shift_report.h"
#include "mapstore/core/input_file.h"
#include "mapstore/map/shift_report_check.h"

namespace shiftmap::transfer {
namespace {

// A piece on a link whose bound we set takes no longer.
constexpr double kLongestPieceS = 60.0;

// The file itself is refused, and will be again.
bool IsRefusal(const Status& status) {
  switch (status.code()) {
    case StatusCode::kInvalidArgument:
    case StatusCode::kNotFound:
    case StatusCode::kPermissionDenied:
    case StatusCode::kOutOfRange:
    case StatusCode::kDataLoss:
      return true;
    default:
      return false;
  }
}

// The link is down: other files would fare no better.
bool IsOfTheLink(const Status& status) {
  return status.code() == StatusCode::kUnavailable ||
         status.code() == StatusCode::kDeadlineExceeded ||
         status.code() == StatusCode::kCancelled || status.code() == StatusCode::kUnauthenticated;
}

}  // namespace

HandIn::HandIn(Outbox* outbox, HandInOptions options)
    : outbox_(*outbox), options_(std::move(options)), limit_(options_.max_bytes_per_s) {
  if (options_.max_bytes_per_s <= 0.0) return;
  const auto in_time = static_cast<std::int64_t>(kLongestPieceS * options_.max_bytes_per_s);
  options_.piece_bytes = std::clamp<std::int64_t>(in_time, 1, options_.piece_bytes);
}

Status HandIn::Pass(const std::stop_token& stop) {
  passed_over_.clear();
  SHIFTMAP_RETURN_IF_ERROR(outbox_.Scan());
  if (outbox_.Waiting().empty()) return OkStatus();
  // Certificates are read anew each time.
  SHIFTMAP_ASSIGN_OR_RETURN(MapClient client, MapClient::Create(options_.server, stop));
  for (;;) {
    if (options_.alive) options_.alive();
    const std::vector<OutboxItem> waiting = outbox_.Waiting();
    const auto next = std::find_if(waiting.begin(), waiting.end(), [&](const OutboxItem& item) {
      return passed_over_.count(item.name) == 0;
    });
    if (next == waiting.end()) break;
    const Status sent = Send(*next, &client);
    if (IsOfTheLink(sent)) return sent;
    SHIFTMAP_RETURN_IF_ERROR(Settle(*next, sent));
    SHIFTMAP_RETURN_IF_ERROR(outbox_.Scan());
  }
  return passed_over_.empty() ? OkStatus() : passed_over_.begin()->second;
}

Status HandIn::Send(const OutboxItem& item, MapClient* client) {
  return item.is_report() ? SendReport(item, client) : SendLog(item, client);
}

Status HandIn::SendReport(const OutboxItem& item, MapClient* client) {
  const std::string path = outbox_.PathOf(item.name);
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string bytes,
                            ReadInputFile("shift report", path, kMaxReportBytes));
  SHIFTMAP_RETURN_IF_ERROR(DecodeShiftReport(bytes).status());
  SHIFTMAP_ASSIGN_OR_RETURN(const SubmitResult result, client->SubmitReport(bytes));
  SHIFTMAP_RETURN_IF_ERROR(outbox_.Acknowledge(item.name));
  ++counts_.reports;
  if (options_.inform) {
    options_.inform(fmt::format("report {}: {}",
                                item.name,
                                result.duplicate
                                    ? std::string("known already")
                                    : fmt::format("{} evidence rows", result.evidence_rows)));
  }
  return OkStatus();
}

Status HandIn::SendLog(const OutboxItem& item, MapClient* client) {
  if (!log_ || log_name_ != item.name) {
    log_.reset();
    SHIFTMAP_ASSIGN_OR_RETURN(log_, LogUpload::Open(outbox_.PathOf(item.name), client->stop()));
    log_name_ = item.name;
  }
  const std::int64_t before = log_->stored_bytes();
  const StatusOr<bool> whole = log_->SendPiece(client, &limit_, options_.piece_bytes);
  counts_.log_bytes += std::max<std::int64_t>(0, log_->stored_bytes() - before);
  SHIFTMAP_RETURN_IF_ERROR(whole.status());
  if (!*whole) return OkStatus();
  SHIFTMAP_RETURN_IF_ERROR(outbox_.Acknowledge(item.name));
  ++counts_.logs;
  if (options_.inform) {
    options_.inform(fmt::format("log {}: {} bytes", item.name, log_->size_bytes()));
  }
  log_.reset();
  return OkStatus();
}

Status HandIn::Settle(const OutboxItem& item, const Status& sent) {
  if (sent.ok()) return sent;
  if (!item.is_report()) log_.reset();
  if (IsRefusal(sent)) {
    ++counts_.refused;
    if (options_.warn) {
      options_.warn(fmt::format("'{}' is refused: {}", outbox_.PathOf(item.name), Message(sent)));
    }
    return outbox_.Refuse(item.name, Message(sent));
  }
  passed_over_[item.name] = sent;
  return OkStatus();
}

}  // namespace shiftmap::transfer
