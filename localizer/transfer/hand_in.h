// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <stop_token>
#include <string>

#include "localizer/transfer/log_upload.h"
#include "localizer/transfer/map_client.h"
#include "localizer/transfer/outbox.h"
#include "localizer/transfer/rate_limit.h"
#include "proto/core/status.h"

namespace shiftmap::transfer {

struct HandInOptions {
  ServerOptions server;
  double max_bytes_per_s = 0.0;  ///< 0: as fast as it goes. [B/s]

  /// Of a log, between two looks for reports. [byte]
  std::int64_t piece_bytes = std::int64_t{4} << 20;

  std::function<void(const std::string&)> warn;
  std::function<void(const std::string&)> inform;
  std::function<void()> alive;  ///< Called between the steps of a pass.
};

/// What passes did so far.
struct HandInCounts {
  std::int64_t reports = 0;  ///< Acknowledged.
  std::int64_t logs = 0;     ///< Acknowledged.
  std::int64_t refused = 0;
  std::int64_t log_bytes = 0;  ///< That arrived.
};

/// Hands in what waits in an outbox: reports first, also those that come while a log is on its way.
/// Threads: one.
class HandIn {
 public:
  HandIn(Outbox* outbox, HandInOptions options);

  /// Tries each file that waits, until the first that the link lets down. One that the server has
  /// no room for, or fails at, is passed over.
  /// Errors: as Outbox; kUnavailable or the like if something is left to be tried again.
  Status Pass(const std::stop_token& stop);

  const HandInCounts& counts() const { return counts_; }

 private:
  Status Send(const OutboxItem& item, MapClient* client);
  Status SendReport(const OutboxItem& item, MapClient* client);
  Status SendLog(const OutboxItem& item, MapClient* client);
  Status Settle(const OutboxItem& item, const Status& sent);

  Outbox& outbox_;
  HandInOptions options_;
  RateLimit limit_;
  HandInCounts counts_;
  std::map<std::string, Status> passed_over_;  // In this pass, by name.
  std::optional<LogUpload> log_;               // The one that is on its way.
  std::string log_name_;
};

}  // namespace shiftmap::transfer
