// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/download_worker.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <utility>

#include "localizer/live/client.h"
#include "mapstore/core/owned_fd.h"

namespace shiftmap::transfer {
namespace {

constexpr double kListenS = 0.5;
constexpr std::size_t kMaxMessageBytes = 1000;

// Bytes at the path; kept from other processes as long as this lives.
class Incoming {
 public:
  explicit Incoming(std::string path) : path_(std::move(path)) {
    constexpr mode_t kAccess = 0640;
    fd_ = OwnedFd(open(path_.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, kAccess));
    if (fd_.get() >= 0) flock(fd_.get(), LOCK_EX | LOCK_NB);
  }
  const std::string& path() const { return path_; }
  std::int64_t bytes() const {
    struct stat info {};
    return fd_.get() >= 0 && fstat(fd_.get(), &info) == 0 ? info.st_size : 0;
  }
  // False if it was empty.
  bool Clear() { return bytes() > 0 && ftruncate(fd_.get(), 0) == 0; }
  void Remove() { unlink(path_.c_str()); }

 private:
  std::string path_;
  OwnedFd fd_;
};

// With retries, until all bytes are there.
// @param pieced  Set where bytes of an earlier try were gone on from.
Status Download(const DownloadWorkerOptions& options,
                const std::string& link,
                const Incoming& incoming,
                const std::stop_token& stop,
                bool* pieced) {
  Backoff backoff(options.backoff, RandomSeed());
  for (;;) {
    const std::int64_t before = incoming.bytes();
    *pieced = *pieced || before > 0;
    const Status status = DownloadMapFile(link, incoming.path(), options.download, stop);
    if (status.ok() || stop.stop_requested()) return status;
    if (incoming.bytes() > before) backoff.Progress();
    if (!backoff.Again(status, stop)) return status;
  }
}

// Pieces may be of another file, or of a server that cannot go on: then once more, from the first
// byte on. A server also cannot go on from the end of a file that is whole.
Status Bring(const DownloadWorkerOptions& options,
             const std::string& link,
             const ExpectedMap& expected,
             MapFolder* folder,
             Incoming* incoming,
             const std::stop_token& stop) {
  for (bool last = false;; last = true) {
    bool pieced = false;
    Status status = Download(options, link, *incoming, stop, &pieced);
    if (!status.ok() && status.code() != StatusCode::kOutOfRange) return status;
    status = folder->Add(incoming->path(), expected).status();
    const bool final = status.ok() || IsTemporary(status) ||
                       status.code() == StatusCode::kAlreadyExists || !pieced || last;
    if (final || !incoming->Clear()) return status;
  }
}

void Tell(live::Client* client, const live::MapDownloadProgress& progress) {
  // If serve is gone, it has failed the action itself.
  client->Send({.id = 0, .command = progress}).IgnoreError();
}

// Of one that ended; a message that serve takes.
live::MapDownloadProgress Ended(const std::string& action_id, const Status& status) {
  std::string message = Message(status);
  if (message.size() > kMaxMessageBytes) message.resize(kMaxMessageBytes);
  return {action_id, true, Status(status.code(), message)};
}

void Do(const DownloadWorkerOptions& options,
        const live::DownloadMap& order,
        live::Client* client,
        const std::stop_token& stop) {
  Tell(client, {order.action_id, false, OkStatus()});
  const ExpectedMap expected{order.map_id, order.map_version, order.sha256};
  const Status status = DownloadIntoFolder(options, order.link, expected, stop);
  Tell(client, Ended(order.action_id, status));
  if (!status.ok()) {
    options.warn(Message(status));
  } else {
    options.inform(fmt::format("map '{}' {} came", order.map_id, order.map_version));
  }
}

Status Listen(const DownloadWorkerOptions& options, const std::stop_token& stop, Pulse* pulse) {
  SHIFTMAP_ASSIGN_OR_RETURN(live::Client client, live::Client::Connect(options.socket));
  live::Subscribe subscribe;
  subscribe.map_downloads = true;
  SHIFTMAP_RETURN_IF_ERROR(client.Call(subscribe).status());
  while (!stop.stop_requested()) {
    pulse->Beat();
    SHIFTMAP_ASSIGN_OR_RETURN(const auto event, client.ReceiveWithin(kListenS));
    if (!event) continue;
    if (const auto* order = std::get_if<live::DownloadMap>(&*event)) {
      Do(options, *order, &client, stop);
    }
  }
  return OkStatus();
}

}  // namespace

Status DownloadIntoFolder(const DownloadWorkerOptions& options,
                          const std::string& link,
                          const ExpectedMap& expected,
                          const std::stop_token& stop) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapFolder folder, MapFolder::Open(options.maps, options.folder));
  SHIFTMAP_ASSIGN_OR_RETURN(
      std::string path,
      folder.Incoming(expected.map_id + "\n" + expected.map_version + "\n" + link));
  Incoming incoming(std::move(path));
  const Status status = Bring(options, link, expected, &folder, &incoming, stop);
  // What may come later goes on from here.
  if (!status.ok() && !IsTemporary(status)) incoming.Remove();
  return status;
}

Workers::Worker DownloadWorker(DownloadWorkerOptions given) {
  return [given = std::move(given)](const std::stop_token& stop, Pulse& pulse) {
    DownloadWorkerOptions options = given;
    options.download.alive = [&pulse] { pulse.Beat(); };
    Backoff backoff({.first_s = 0.5, .longest_s = 10.0}, RandomSeed());
    std::string told;
    while (!stop.stop_requested()) {
      pulse.Beat();
      const Status status = Listen(options, stop, &pulse);
      const std::string line = fmt::format("socket '{}': {}", options.socket, Message(status));
      if (!status.ok() && std::exchange(told, line) != line) options.warn(line);
      SleepFor(backoff.NextDelayS(), stop);
    }
  };
}

}  // namespace shiftmap::transfer
