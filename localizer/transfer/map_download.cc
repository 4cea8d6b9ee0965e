// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/map_download.h"

#include <curl/curl.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <cstring>
#include <memory>
#include <mutex>

#include "mapstore/core/owned_fd.h"

namespace shiftmap::transfer {
namespace {

constexpr long kConnectMs = 20'000;  // Until a connection stands. [ms]
constexpr long kMaxRedirects = 5;
constexpr long kOk = 200;
constexpr long kPartialContent = 206;
constexpr long kUnauthorized = 401;
constexpr long kForbidden = 403;
constexpr long kNotFoundCode = 404;
constexpr long kTimeout = 408;
constexpr long kGone = 410;
constexpr long kNotInRange = 416;
constexpr long kTooMany = 429;
constexpr long kServerErrors = 500;

// One transfer, as the callbacks of curl see it.
struct Transfer {
  CURL* curl = nullptr;
  int fd = -1;
  std::int64_t begin = 0;  // Bytes that were there.
  std::int64_t came = 0;
  std::int64_t max_bytes = 0;
  const std::stop_token* stop = nullptr;
  const std::function<void()>* alive = nullptr;
  Status status;  // Why a callback ended it.
};

std::size_t Fail(Transfer* transfer, Status status) {
  transfer->status = std::move(status);
  return 0;
}

// A body of an error page is no part of the file.
std::size_t Write(char* bytes, std::size_t, std::size_t count, void* user) {
  auto* transfer = static_cast<Transfer*>(user);
  long code = 0;
  curl_easy_getinfo(transfer->curl, CURLINFO_RESPONSE_CODE, &code);
  if (code != (transfer->begin > 0 ? kPartialContent : kOk)) return count;
  transfer->came += static_cast<std::int64_t>(count);
  if (transfer->begin + transfer->came > transfer->max_bytes) {
    return Fail(
        transfer,
        InvalidArgument("file is too large, expected at most {} bytes", transfer->max_bytes));
  }
  for (std::size_t done = 0; done < count;) {
    const ssize_t written = write(transfer->fd, bytes + done, count - done);
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) {
      return Fail(transfer, Unavailable("cannot write the file: {}", std::strerror(errno)));
    }
    done += static_cast<std::size_t>(written);
  }
  return count;
}

int Progress(void* user, curl_off_t, curl_off_t, curl_off_t, curl_off_t) {
  const auto* transfer = static_cast<const Transfer*>(user);
  if (*transfer->alive) (*transfer->alive)();
  return transfer->stop->stop_requested() ? 1 : 0;
}

void SetOptions(const std::string& link, const MapDownloadOptions& options, Transfer* transfer) {
  CURL* const curl = transfer->curl;
  curl_easy_setopt(curl, CURLOPT_URL, link.c_str());
  curl_easy_setopt(curl, CURLOPT_PROTOCOLS_STR, "https");
  curl_easy_setopt(curl, CURLOPT_REDIR_PROTOCOLS_STR, "https");
  curl_easy_setopt(curl, CURLOPT_FOLLOWLOCATION, 1L);
  curl_easy_setopt(curl, CURLOPT_MAXREDIRS, kMaxRedirects);
  curl_easy_setopt(curl, CURLOPT_SSL_VERIFYPEER, 1L);
  curl_easy_setopt(curl, CURLOPT_SSL_VERIFYHOST, 2L);
  if (!options.ca.empty()) {
    curl_easy_setopt(curl, CURLOPT_CAINFO, options.ca.c_str());
    curl_easy_setopt(curl, CURLOPT_CAPATH, nullptr);
  }
  // Compressed on the way, a file could not be gone on with.
  curl_easy_setopt(curl, CURLOPT_ACCEPT_ENCODING, nullptr);
  curl_easy_setopt(curl, CURLOPT_NOSIGNAL, 1L);
  curl_easy_setopt(curl, CURLOPT_CONNECTTIMEOUT_MS, kConnectMs);
  curl_easy_setopt(curl, CURLOPT_LOW_SPEED_LIMIT, 1L);
  curl_easy_setopt(curl, CURLOPT_LOW_SPEED_TIME, std::lround(std::ceil(options.silent_s)));
  curl_easy_setopt(curl,
                   CURLOPT_MAX_RECV_SPEED_LARGE,
                   static_cast<curl_off_t>(std::llround(options.max_bytes_per_s)));
  if (transfer->begin > 0) {
    curl_easy_setopt(curl, CURLOPT_RESUME_FROM_LARGE, static_cast<curl_off_t>(transfer->begin));
  }
  curl_easy_setopt(curl, CURLOPT_WRITEFUNCTION, Write);
  curl_easy_setopt(curl, CURLOPT_WRITEDATA, transfer);
  curl_easy_setopt(curl, CURLOPT_XFERINFOFUNCTION, Progress);
  curl_easy_setopt(curl, CURLOPT_XFERINFODATA, transfer);
  curl_easy_setopt(curl, CURLOPT_NOPROGRESS, 0L);
}

Status StatusOfAnswer(const Transfer& transfer, long code) {
  if (code == (transfer.begin > 0 ? kPartialContent : kOk)) return OkStatus();
  StatusCode kind = StatusCode::kInvalidArgument;
  if (code == kNotFoundCode || code == kGone) kind = StatusCode::kNotFound;
  if (code == kUnauthorized || code == kForbidden) kind = StatusCode::kPermissionDenied;
  if (code == kTimeout || code == kTooMany || code >= kServerErrors)
    kind = StatusCode::kUnavailable;
  if (transfer.begin > 0 && (code == kNotInRange || code == kOk)) kind = StatusCode::kOutOfRange;
  return MakeStatus(kind, "the server answers {}", code);
}

Status StatusOf(const Transfer& transfer, CURLcode result, const char* text) {
  if (!transfer.status.ok()) return transfer.status;
  long code = 0;
  curl_easy_getinfo(transfer.curl, CURLINFO_RESPONSE_CODE, &code);
  const std::string message = *text != '\0' ? text : curl_easy_strerror(result);
  switch (result) {
    case CURLE_OK:
      return StatusOfAnswer(transfer, code);
    case CURLE_RANGE_ERROR:
      return MakeStatus(StatusCode::kOutOfRange, "the server cannot go on within a file");
    case CURLE_UNSUPPORTED_PROTOCOL:
    case CURLE_URL_MALFORMAT:
      return InvalidArgument("{}, expected https", message);
    case CURLE_TOO_MANY_REDIRECTS:
      return InvalidArgument("{}", message);
    case CURLE_PEER_FAILED_VERIFICATION:
    case CURLE_SSL_CACERT_BADFILE:
    case CURLE_SSL_ISSUER_ERROR:
      return MakeStatus(StatusCode::kPermissionDenied, "certificate: {}", message);
    default:
      return Unavailable("{}", message);
  }
}

Status Download(const std::string& link,
                const std::string& path,
                const MapDownloadOptions& options,
                const std::stop_token& stop) {
  static std::once_flag once;
  std::call_once(once, [] { curl_global_init(CURL_GLOBAL_DEFAULT); });
  constexpr mode_t kAccess = 0640;
  const OwnedFd fd(open(path.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, kAccess));
  struct stat info {};
  if (fd.get() < 0 || fstat(fd.get(), &info) != 0) {
    return Unavailable("cannot write '{}': {}", path, std::strerror(errno));
  }
  const std::unique_ptr<CURL, decltype(&curl_easy_cleanup)> curl(curl_easy_init(),
                                                                 &curl_easy_cleanup);
  if (curl == nullptr) return Unavailable("no memory");
  Transfer transfer;
  transfer.curl = curl.get();
  transfer.fd = fd.get();
  transfer.begin = info.st_size;
  transfer.max_bytes = options.max_bytes;
  transfer.stop = &stop;
  transfer.alive = &options.alive;
  char text[CURL_ERROR_SIZE] = {};
  curl_easy_setopt(curl.get(), CURLOPT_ERRORBUFFER, text);
  SetOptions(link, options, &transfer);
  const CURLcode result = curl_easy_perform(curl.get());
  return StatusOf(transfer, result, text);
}

}  // namespace

Status DownloadMapFile(const std::string& link,
                       const std::string& path,
                       const MapDownloadOptions& options,
                       const std::stop_token& stop) {
  return Annotate(Download(link, path, options, stop), "link '{}'", link);
}

}  // namespace shiftmap::transfer
