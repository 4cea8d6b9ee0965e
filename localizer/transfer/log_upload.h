// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <fstream>
#include <functional>
#include <stop_token>
#include <string>
#include <utility>

#include "localizer/transfer/backoff.h"
#include "localizer/transfer/map_client.h"
#include "localizer/transfer/rate_limit.h"
#include "proto/core/status.h"

namespace shiftmap::transfer {

/// A run log on its way to the server, in pieces between which other things can be handed in.
///
/// Errors, of every function: as MapClient; kNotFound if the file is gone; kUnavailable if it
/// cannot be read. Those about the file start with `run log 'PATH': `.
class LogUpload {
 public:
  /// Reads the file once, for its hash. Errors also: kCancelled if a stop is requested meanwhile.
  static StatusOr<LogUpload> Open(const std::string& path, const std::stop_token& stop = {});

  /// Sends the next piece, from where the server says that it has arrived. True once the server has
  /// the whole file.
  /// Errors also: kInvalidArgument if it became shorter meanwhile.
  StatusOr<bool> SendPiece(MapClient* client, RateLimit* limit, std::int64_t piece_bytes);

  const std::string& sha256() const { return sha256_; }
  std::int64_t size_bytes() const { return size_bytes_; }
  std::int64_t stored_bytes() const { return stored_bytes_; }  ///< On the server, as it last said.
  std::int64_t sent_bytes() const { return sent_bytes_; }      ///< By this object.

 private:
  LogUpload(std::string path, std::ifstream file)
      : path_(std::move(path)), file_(std::move(file)) {}

  std::string path_;
  std::ifstream file_;
  std::string sha256_;
  std::int64_t size_bytes_ = 0;
  std::int64_t stored_bytes_ = 0;
  std::int64_t sent_bytes_ = 0;
  int refused_offsets_ = 0;  // In a row.
  int wrong_hashes_ = 0;
};

struct UploadOptions {
  BackoffOptions backoff;
  double max_bytes_per_s = 0.0;  ///< 0: as fast as it goes. [B/s]
  std::int64_t piece_bytes = std::int64_t{16} << 20;

  /// Called with the share that is there, in [0, 1]; may be null.
  std::function<void(double)> progress;
};

struct UploadResult {
  std::string sha256;
  std::int64_t size_bytes = 0;
  std::int64_t sent_bytes = 0;
  bool known_already = false;  ///< The server had the whole file.
  int retries = 0;
};

/// Uploads a whole log. Tries again while the link is bad, and goes on where it was cut.
StatusOr<UploadResult> UploadLog(MapClient* client,
                                 const std::string& path,
                                 const UploadOptions& options);

}  // namespace shiftmap::transfer
