// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/log_upload.h"

#include <algorithm>

#include "mapstore/core/input_file.h"
#include "mapstore/map/sha256.h"

namespace shiftmap::transfer {
namespace {

constexpr std::size_t kMessageBytes = std::size_t{64} << 10;

// The server may still take in what an older connection left, or have lost the newest bytes.
constexpr int kMaxRefusedOffsets = 5;

// Bytes on the server may have been damaged by a power failure there, once.
constexpr int kMaxWrongHashes = 2;

Status About(const std::string& path, const Status& status) {
  return Annotate(status, "run log '{}'", path);
}

}  // namespace

StatusOr<LogUpload> LogUpload::Open(const std::string& path, const std::stop_token& stop) {
  StatusOr<std::ifstream> file = OpenInputFile(path);
  if (!file.ok()) return About(path, file.status());
  LogUpload upload(path, *std::move(file));
  Sha256 hash;
  std::string bytes(kMessageBytes, '\0');
  while (upload.file_.read(bytes.data(), static_cast<std::streamsize>(bytes.size())) ||
         upload.file_.gcount() > 0) {
    if (stop.stop_requested()) return MakeStatus(StatusCode::kCancelled, "stopped");
    const auto count = static_cast<std::size_t>(upload.file_.gcount());
    hash.Update(std::string_view(bytes.data(), count));
    upload.size_bytes_ += static_cast<std::int64_t>(count);
  }
  if (upload.file_.bad()) return About(path, Unavailable("cannot be read"));
  upload.sha256_ = hash.HexDigest();
  return upload;
}

StatusOr<bool> LogUpload::SendPiece(MapClient* client, RateLimit* limit, std::int64_t piece_bytes) {
  SHIFTMAP_ASSIGN_OR_RETURN(UploadState state, client->GetUpload(sha256_));
  stored_bytes_ = state.stored_bytes;
  if (state.complete) return true;
  const std::int64_t end = std::min(size_bytes_, state.stored_bytes + piece_bytes);
  std::int64_t at = state.stored_bytes;
  file_.clear();
  file_.seekg(at);
  const auto next = [&]() -> StatusOr<std::string> {
    const auto count = static_cast<std::size_t>(
        std::clamp<std::int64_t>(end - at, 0, static_cast<std::int64_t>(kMessageBytes)));
    std::string bytes(count, '\0');
    if (count > 0 && !file_.read(bytes.data(), static_cast<std::streamsize>(count))) {
      return About(path_, InvalidArgument("it has become shorter"));
    }
    if (!limit->Take(count, client->stop())) {
      return MakeStatus(StatusCode::kCancelled, "stopped");
    }
    at += static_cast<std::int64_t>(count);
    sent_bytes_ += static_cast<std::int64_t>(count);
    return bytes;
  };
  const StatusOr<UploadState> sent = client->UploadLog(sha256_, size_bytes_, at, next);
  if (sent.ok()) {
    refused_offsets_ = 0;
    stored_bytes_ = sent->stored_bytes;
    return sent->complete;
  }
  if (sent.status().code() == StatusCode::kAlreadyExists) return true;
  const bool elsewhere = sent.status().code() == StatusCode::kOutOfRange ||
                         sent.status().code() == StatusCode::kAborted;
  const bool offset_refused = elsewhere && ++refused_offsets_ < kMaxRefusedOffsets;
  const bool hash_refused =
      sent.status().code() == StatusCode::kDataLoss && ++wrong_hashes_ < kMaxWrongHashes;
  if (offset_refused || hash_refused) return Unavailable("{}", Message(sent.status()));
  return sent.status();
}

StatusOr<UploadResult> UploadLog(MapClient* client,
                                 const std::string& path,
                                 const UploadOptions& options) {
  SHIFTMAP_ASSIGN_OR_RETURN(LogUpload upload, LogUpload::Open(path, client->stop()));
  RateLimit limit(options.max_bytes_per_s);
  Backoff backoff(options.backoff, RandomSeed());
  for (;;) {
    const std::int64_t before = upload.stored_bytes();
    const StatusOr<bool> whole = upload.SendPiece(client, &limit, options.piece_bytes);
    if (whole.ok() && *whole) break;
    if (upload.stored_bytes() > before) backoff.Progress();
    if (options.progress && upload.size_bytes() > 0) {
      options.progress(static_cast<double>(upload.stored_bytes()) /
                       static_cast<double>(upload.size_bytes()));
    }
    if (!whole.ok() && !backoff.Again(whole.status(), client->stop())) {
      return About(path, whole.status());
    }
  }
  return UploadResult{.sha256 = upload.sha256(),
                      .size_bytes = upload.size_bytes(),
                      .sent_bytes = upload.sent_bytes(),
                      .known_already = upload.sent_bytes() == 0,
                      .retries = backoff.retries()};
}

}  // namespace shiftmap::transfer
