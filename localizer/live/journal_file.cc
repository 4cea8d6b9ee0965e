// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/journal_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <fstream>
#include <system_error>
#include <utility>

#include "mapstore/core/atomic_file.h"
#include "proto/core/check.h"
#include "proto/mcap/crc32.h"

namespace shiftmap::live {
namespace {

constexpr std::string_view kMagic = "SHMJRNL1";
constexpr std::size_t kNumberBytes = 4;
constexpr std::size_t kHeadBytes = 2 * kNumberBytes;
constexpr unsigned kBitsPerByte = 8;

void AppendNumber(std::uint32_t number, std::string* out) {
  for (std::size_t i = 0; i < kNumberBytes; ++i) {
    out->push_back(static_cast<char>((number >> (kBitsPerByte * i)) & 0xffu));
  }
}

std::uint32_t NumberAt(std::string_view bytes) {
  std::uint32_t number = 0;
  for (std::size_t i = 0; i < kNumberBytes; ++i) {
    number |= static_cast<std::uint32_t>(static_cast<unsigned char>(bytes[i]))
              << (kBitsPerByte * i);
  }
  return number;
}

std::uint32_t Checksum(std::string_view length, std::string_view content) {
  mcap::Crc32 crc;
  crc.Update(length);
  crc.Update(content);
  return crc.value();
}

template <typename... Args>
Status About(StatusCode code,
             const std::string& path,
             fmt::format_string<Args...> format,
             Args&&... args) {
  return MakeStatus(
      code, "journal '{}': {}", path, fmt::format(format, std::forward<Args>(args)...));
}

Status ErrnoStatus(const std::string& path, const char* action) {
  return About(StatusCode::kUnavailable, path, "cannot {}: {}", action, std::strerror(errno));
}

// One record of the stream into `content`; false if it is not whole.
bool ReadRecord(std::istream* in, std::string* content) {
  std::array<char, kHeadBytes> head{};
  if (!in->read(head.data(), head.size())) return false;
  const std::string_view length_bytes(head.data(), kNumberBytes);
  const std::uint32_t length = NumberAt(length_bytes);
  if (length > JournalFile::kMaxRecordBytes) return false;
  content->resize(length);
  if (!in->read(content->data(), static_cast<std::streamsize>(length))) return false;
  return Checksum(length_bytes, *content) ==
         NumberAt(std::string_view(head.data() + kNumberBytes, kNumberBytes));
}

}  // namespace

StatusOr<JournalFile> JournalFile::Create(const std::string& path) {
  if (access(path.c_str(), F_OK) == 0) {
    return About(StatusCode::kAlreadyExists, path, "exists already");
  }
  SHIFTMAP_RETURN_IF_ERROR(WriteFileAtomically(path, kMagic));
  return Resume(path, kMagic.size());
}

StatusOr<JournalFile> JournalFile::Resume(const std::string& path, std::uint64_t bytes) {
  const int fd = open(path.c_str(), O_WRONLY | O_APPEND | O_CLOEXEC);
  if (fd < 0) return ErrnoStatus(path, "open");
  JournalFile journal(path, fd);
  if (ftruncate(fd, static_cast<off_t>(bytes)) != 0) return ErrnoStatus(path, "truncate");
  return journal;
}

JournalFile::JournalFile(JournalFile&& other) noexcept
    : path_(std::move(other.path_)),
      fd_(std::exchange(other.fd_, -1)),
      unwritten_(std::move(other.unwritten_)),
      ended_(other.ended_),
      syncing_(std::move(other.syncing_)) {}

JournalFile& JournalFile::operator=(JournalFile&& other) noexcept {
  std::swap(path_, other.path_);
  std::swap(fd_, other.fd_);
  std::swap(unwritten_, other.unwritten_);
  std::swap(ended_, other.ended_);
  std::swap(syncing_, other.syncing_);
  return *this;
}

JournalFile::~JournalFile() {
  if (syncing_.valid()) syncing_.wait();
  if (fd_ >= 0) close(fd_);
}

void JournalFile::Append(std::string_view record) {
  SHIFTMAP_CHECK(record.size() <= kMaxRecordBytes, "record of {} bytes", record.size());
  ended_ = ended_ || unwritten_.size() + record.size() > kMaxUnwrittenBytes;
  if (ended_) return;
  std::string length;
  AppendNumber(static_cast<std::uint32_t>(record.size()), &length);
  unwritten_ += length;
  AppendNumber(Checksum(length, record), &unwritten_);
  unwritten_ += record;
}

Status JournalFile::Flush() {
  std::string_view left = unwritten_;
  while (!left.empty()) {
    const ssize_t written = write(fd_, left.data(), left.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) {
      const Status status = ErrnoStatus(path_, "write");
      unwritten_.erase(0, unwritten_.size() - left.size());
      return status;
    }
    left.remove_prefix(static_cast<std::size_t>(written));
  }
  unwritten_.clear();
  constexpr std::size_t kKept = std::size_t{1} << 20;
  if (unwritten_.capacity() > kKept) unwritten_.shrink_to_fit();
  return OkStatus();
}

Status JournalFile::Whole() const {
  if (!ended_) return OkStatus();
  return About(
      StatusCode::kUnavailable,
      path_,
      "it ends where the disk was full for {} MiB; the rest of the shift is missing there, and "
      "in the run log that is made of it",
      kMaxUnwrittenBytes >> 20);
}

Status JournalFile::Write() {
  SHIFTMAP_RETURN_IF_ERROR(Flush());
  return Whole();
}

Status JournalFile::Sync() {
  SHIFTMAP_RETURN_IF_ERROR(Flush());
  const Status before = syncing_.valid() ? syncing_.get() : OkStatus();
  if (fdatasync(fd_) != 0) return ErrnoStatus(path_, "sync");
  return before.ok() ? Whole() : before;
}

Status JournalFile::StartSync() {
  SHIFTMAP_RETURN_IF_ERROR(Flush());
  Status before = OkStatus();
  if (syncing_.valid()) {
    if (syncing_.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return OkStatus();
    before = syncing_.get();
  }
  const auto sync = [fd = fd_, path = path_] {
    return fdatasync(fd) == 0 ? OkStatus() : ErrnoStatus(path, "sync");
  };
  try {
    syncing_ = std::async(std::launch::async, sync);
  } catch (const std::system_error&) {  // The process may have no more threads.
    SHIFTMAP_RETURN_IF_ERROR(sync());
  }
  return before;
}

StatusOr<JournalEnd> ReadJournal(const std::string& path,
                                 const std::function<Status(std::string_view)>& take) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return About(StatusCode::kNotFound, path, "cannot open: {}", std::strerror(errno));
  std::string content(kMagic.size(), '\0');
  file.read(content.data(), static_cast<std::streamsize>(content.size()));
  if (!file || content != kMagic) {
    return About(StatusCode::kDataLoss, path, "does not begin with {}", kMagic);
  }
  JournalEnd end;
  end.whole_bytes = kMagic.size();
  while (ReadRecord(&file, &content)) {
    if (const Status status = take(content); !status.ok()) {
      return About(status.code(), path, "record {}: {}", end.records + 1, Message(status));
    }
    ++end.records;
    end.whole_bytes += kHeadBytes + content.size();
  }
  if (file.bad()) return ErrnoStatus(path, "read");
  file.clear();
  file.seekg(0, std::ios::end);
  end.cut_bytes = static_cast<std::uint64_t>(file.tellg()) - end.whole_bytes;
  return end;
}

}  // namespace shiftmap::live
