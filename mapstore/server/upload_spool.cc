// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/upload_spool.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <optional>
#include <utility>
#include <vector>

#include "mapstore/codec/run_log.h"
#include "mapstore/core/atomic_file.h"
#include "mapstore/core/clock.h"
#include "mapstore/core/day.h"
#include "mapstore/core/file_name.h"
#include "mapstore/core/folder.h"
#include "mapstore/map/sha256.h"
#include "mapstore/map/shift_report_check.h"

namespace shiftmap::server {
namespace {

constexpr const char* kSpoolFolder = "/.uploads/";
constexpr const char* kPart = ".part";
constexpr const char* kDone = ".done";

// Logs of which it is known how far they came, beyond those that are on their way.
constexpr std::size_t kKnownTurns = 1024;

// For how long it is known that a log was whole. [s]
constexpr double kRememberedS = 90 * kSecondsPerDay;

Status Failed(const std::string& path, const char* action) {
  const int error = errno;
  const bool full = error == ENOSPC || error == EDQUOT || error == EFBIG;
  return MakeStatus(full ? StatusCode::kResourceExhausted : StatusCode::kUnavailable,
                    "run log '{}': cannot be {}: {}",
                    std::filesystem::path(path).filename().string(),
                    action,
                    std::strerror(error));
}

bool Exists(const std::string& path) {
  std::error_code error;
  return std::filesystem::exists(path, error);
}

void Remove(const std::string& path) {
  std::error_code ignored;
  std::filesystem::remove(path, ignored);
}

// Drops what came of a log. The word that it was whole goes first: without its bytes it would stand
// for a log that is nowhere.
void Drop(const std::string& path) {
  Remove(path + kDone);
  Remove(path + kPart);
}

std::int64_t BytesIn(const std::string& folder) {
  std::int64_t bytes = 0;
  std::error_code error;
  std::filesystem::recursive_directory_iterator entry(folder, error);
  for (; !error && entry != std::filesystem::end(entry); entry.increment(error)) {
    std::error_code gone;
    const bool counts = entry->is_regular_file(gone) && !entry->is_symlink(gone);
    const std::uintmax_t size = counts ? entry->file_size(gone) : 0;
    if (!gone) bytes += static_cast<std::int64_t>(size);
  }
  return bytes;
}

double AgeS(const std::filesystem::path& path) {
  struct stat info {};
  if (stat(path.c_str(), &info) != 0) return 0.0;
  return ToSecondsSinceEpoch(SystemNow()) - static_cast<double>(info.st_mtim.tv_sec);
}

// The head of a log, of which the rest need not be whole.
StatusOr<RunInfo> ReadRunInfo(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(RunLogStream stream, RunLogStream::Open(path, /*lidar_scans=*/false));
  SHIFTMAP_RETURN_IF_ERROR(stream.Next().status());
  return stream.info();
}

}  // namespace

// What uploads of one log share: who of them may write, and the hash of what is here. It outlives
// them, so that an upload that goes on hashes only what is new.
struct UploadSpool::Upload::Turn {
  std::mutex mutex;
  std::int64_t last = 0;
  std::optional<Sha256> hash;  // Of the first `hashed_bytes`.
  std::int64_t hashed_bytes = 0;

  // Under UploadSpool::mutex_.
  std::string client;
  std::int64_t reserved_bytes = 0;  // That are to come.
  std::int64_t reserved_by = 0;     // Upload::number_.
};

// Quota that an upload has reserved and not used; returned with the upload.
class UploadSpool::Upload::Room {
 public:
  Room(UploadSpool* spool, std::shared_ptr<Turn> turn, std::int64_t number)
      : spool_(*spool), turn_(std::move(turn)), number_(number) {}
  Room(const Room&) = delete;
  Room& operator=(const Room&) = delete;
  ~Room() {
    const std::lock_guard lock(spool_.mutex_);
    // Another upload may have taken its place.
    if (turn_->reserved_by == number_) turn_->reserved_bytes = 0;
  }

  // Bytes that came.
  void Use(std::int64_t bytes) {
    const std::lock_guard lock(spool_.mutex_);
    spool_.folder_bytes_ += bytes;
    if (turn_->reserved_by == number_) turn_->reserved_bytes -= bytes;
  }

 private:
  UploadSpool& spool_;
  const std::shared_ptr<Turn> turn_;
  const std::int64_t number_;
};

StatusOr<std::unique_ptr<UploadSpool>> UploadSpool::Open(const std::string& logs,
                                                         const UploadLimits& limits) {
  SHIFTMAP_RETURN_IF_ERROR(MakeFolder(logs + kSpoolFolder));
  std::unique_ptr<UploadSpool> spool(new UploadSpool(logs, limits));
  spool->Maintain();
  return spool;
}

std::string UploadSpool::PathOf(const std::string& client, const std::string& sha256) const {
  return logs_ + kSpoolFolder + FileNameOf(client) + "/" + sha256;
}

StatusOr<UploadProgress> UploadSpool::Progress(const std::string& client,
                                               const std::string& sha256) {
  const std::string path = PathOf(client, sha256);
  const OwnedFd fd(open((path + kPart).c_str(), O_RDWR | O_CLOEXEC));
  if (fd.get() < 0) return UploadProgress{0, Exists(path + kDone)};
  struct stat info {};
  if (fsync(fd.get()) != 0 || fstat(fd.get(), &info) != 0) return Failed(path, "synced");
  return UploadProgress{info.st_size, false};
}

// Checks the quotas, with what uploads that are under way may still write, and reserves the bytes
// for the turn's next upload.
Status UploadSpool::Reserve(const std::string& client,
                            std::int64_t more_bytes,
                            Upload::Turn* turn) {
  const std::lock_guard lock(mutex_);
  const std::string name = FileNameOf(client);
  std::int64_t of_client = BytesIn(logs_ + "/" + name) + BytesIn(logs_ + kSpoolFolder + name);
  std::int64_t of_folder = folder_bytes_;
  for (const auto& [path, other] : turns_) {
    if (other.get() == turn) continue;
    of_folder += other->reserved_bytes;
    if (other->client == client) of_client += other->reserved_bytes;
  }
  if (of_client + more_bytes > limits_.max_client_bytes) {
    return MakeStatus(StatusCode::kResourceExhausted,
                      "logs of '{}': {} bytes and {} more, the quota is {}",
                      client,
                      of_client,
                      more_bytes,
                      limits_.max_client_bytes);
  }
  if (of_folder + more_bytes > limits_.max_folder_bytes) {
    return MakeStatus(StatusCode::kResourceExhausted,
                      "the log folder has {} bytes, {} more are beyond its quota",
                      of_folder,
                      more_bytes);
  }
  std::error_code error;
  const std::filesystem::space_info space = std::filesystem::space(logs_, error);
  if (!error && space.available < static_cast<std::uintmax_t>(limits_.keep_free_bytes) +
                                      static_cast<std::uintmax_t>(more_bytes)) {
    return MakeStatus(StatusCode::kResourceExhausted,
                      "the disk of the log folder has {} bytes left",
                      space.available);
  }
  turn->reserved_bytes = more_bytes;
  turn->reserved_by = turn->last + 1;
  return OkStatus();
}

std::shared_ptr<UploadSpool::Upload::Turn> UploadSpool::TurnOf(const std::string& client,
                                                               const std::string& path) {
  const std::lock_guard lock(mutex_);
  if (turns_.size() >= kKnownTurns) {
    std::erase_if(turns_, [](const auto& each) { return each.second.use_count() == 1; });
  }
  std::shared_ptr<Upload::Turn>& turn = turns_[path];
  if (!turn) turn = std::make_shared<Upload::Turn>();
  turn->client = client;
  return turn;
}

StatusOr<UploadSpool::Upload> UploadSpool::Begin(const std::string& client,
                                                 const std::string& sha256,
                                                 std::int64_t size_bytes,
                                                 std::int64_t offset_bytes) {
  if (size_bytes > limits_.max_log_bytes) {
    return InvalidArgument(
        "run log of {} bytes: expected at most {}", size_bytes, limits_.max_log_bytes);
  }
  Upload upload;
  upload.sha256_ = sha256;
  upload.path_ = PathOf(client, sha256);
  upload.size_bytes_ = size_bytes;
  upload.turn_ = TurnOf(client, upload.path_);
  const std::lock_guard lock(upload.turn_->mutex);
  const std::string part = upload.path_ + kPart;
  if (!Exists(part) && Exists(upload.path_ + kDone)) {
    return MakeStatus(StatusCode::kAlreadyExists, "run log {}: is here already", sha256);
  }
  struct stat info {};
  if (stat(part.c_str(), &info) != 0 && errno != ENOENT) return Failed(part, "opened");
  if (info.st_size != offset_bytes) {
    return MakeStatus(StatusCode::kOutOfRange,
                      "offset_bytes {}: {} bytes of run log {} are here",
                      offset_bytes,
                      info.st_size,
                      sha256);
  }
  SHIFTMAP_RETURN_IF_ERROR(Reserve(client, size_bytes - offset_bytes, upload.turn_.get()));
  upload.number_ = ++upload.turn_->last;
  upload.room_ = std::make_shared<Upload::Room>(this, upload.turn_, upload.number_);
  SHIFTMAP_RETURN_IF_ERROR(MakeFolder(std::filesystem::path(part).parent_path()));
  upload.fd_ = OwnedFd(open(part.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0640));
  if (upload.fd_.get() < 0) return Failed(part, "opened");
  upload.stored_bytes_ = offset_bytes;
  if (!upload.turn_->hash || upload.turn_->hashed_bytes != offset_bytes) {
    SHIFTMAP_ASSIGN_OR_RETURN(upload.turn_->hash, BeginHash(part));
    upload.turn_->hashed_bytes = offset_bytes;
  }
  return upload;
}

Status UploadSpool::Upload::Append(std::string_view bytes) {
  if (static_cast<std::int64_t>(bytes.size()) > size_bytes_ - stored_bytes_) {
    return InvalidArgument("run log {}: more than its {} bytes", sha256_, size_bytes_);
  }
  const std::lock_guard lock(turn_->mutex);
  if (turn_->last != number_) {
    return MakeStatus(StatusCode::kAborted, "run log {}: another upload goes on", sha256_);
  }
  while (!bytes.empty()) {
    const ssize_t written = write(fd_.get(), bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return Failed(path_, "written");
    turn_->hash->Update(bytes.substr(0, static_cast<std::size_t>(written)));
    turn_->hashed_bytes += written;
    bytes.remove_prefix(static_cast<std::size_t>(written));
    stored_bytes_ += written;
    room_->Use(written);
  }
  return OkStatus();
}

StatusOr<std::string> UploadSpool::Place(const Upload& upload, const RunInfo& info) const {
  const std::string folder = FileNameOf(info.vehicle);
  SHIFTMAP_RETURN_IF_ERROR(MakeFolder(logs_ + "/" + folder));
  const bool has_uuid = IsUuid(info.uuid);
  std::string place =
      folder + "/" + (has_uuid ? LowerCaseUuid(info.uuid) : upload.sha256_) + ".mcap";
  if (has_uuid && Exists(logs_ + "/" + place)) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::string there, HashFile(logs_ + "/" + place));
    // Another recording of the run.
    if (there != upload.sha256_) place = folder + "/" + upload.sha256_ + ".mcap";
  }
  return place;
}

StatusOr<UploadProgress> UploadSpool::Finish(Upload upload,
                                             const std::function<Status(const RunInfo&)>& accept) {
  const std::lock_guard lock(upload.turn_->mutex);
  const std::string part = upload.path_ + kPart;
  if (fsync(upload.fd_.get()) != 0) return Failed(part, "synced");
  if (upload.turn_->last != upload.number_ || upload.stored_bytes_ < upload.size_bytes_) {
    return UploadProgress{upload.stored_bytes_, false};
  }
  const std::string sha256 = std::exchange(upload.turn_->hash, std::nullopt)->HexDigest();
  if (sha256 != upload.sha256_) {
    Drop(upload.path_);
    return DataLoss("run log {}: what came has the hash {}", upload.sha256_, sha256);
  }
  const StatusOr<RunInfo> info = ReadRunInfo(part);
  if (!info.ok()) {
    if (info.status().code() == StatusCode::kUnavailable) return info.status();
    Drop(upload.path_);
    std::string why = Message(info.status());  // But not where the server keeps what comes in.
    if (const auto at = why.find(part); at != std::string::npos) {
      why.replace(at, part.size(), upload.sha256_);
    }
    return InvalidArgument("{}", why);
  }
  if (const Status accepted = accept(*info); !accepted.ok()) {
    const bool for_ever = accepted.code() == StatusCode::kPermissionDenied ||
                          accepted.code() == StatusCode::kInvalidArgument;
    if (for_ever) Drop(upload.path_);
    return accepted;
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string place, Place(upload, *info));
  // In this order: where a part is, the log is not done, and the upload goes on from its end.
  SHIFTMAP_RETURN_IF_ERROR(WriteFileAtomically(upload.path_ + kDone, place + "\n"));
  const Status placed = SyncAndRename(part, logs_ + "/" + place);
  if (!placed.ok()) return Unavailable("run log {}: {}", upload.sha256_, Message(placed));
  return UploadProgress{upload.size_bytes_, true};
}

void UploadSpool::Maintain() {
  std::error_code error;
  std::filesystem::recursive_directory_iterator entry(logs_ + kSpoolFolder, error);
  for (; !error && entry != std::filesystem::end(entry); entry.increment(error)) {
    const std::filesystem::path& path = entry->path();
    if (path.extension() == kPart && AgeS(path) > limits_.abandoned_s) {
      Drop((path.parent_path() / path.stem()).string());
    } else if (path.extension() == kDone && AgeS(path) > kRememberedS) {
      Remove(path);
    }
  }
  folder_bytes_ = BytesIn(logs_);
}

}  // namespace shiftmap::server
