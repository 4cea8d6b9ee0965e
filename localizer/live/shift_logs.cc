// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/shift_logs.h"

#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <string_view>
#include <system_error>
#include <utility>
#include <variant>
#include <vector>

#include "localizer/filter/event_buffer.h"
#include "localizer/live/codec/journal_codec.h"
#include "localizer/live/journal_file.h"
#include "localizer/live/messages.h"
#include "mapstore/codec/run_log.h"

namespace shiftmap::live {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kLog = ".mcap";
constexpr const char* kWaiting = ".journal";
constexpr const char* kUnrecorded = ".unrecorded";
constexpr const char* kRecording = ".recording";
constexpr std::size_t kUuidLength = 36;
constexpr int kLowestPriority = 19;

// Writes the items of a journal as a run log.
class LogMaker {
 public:
  explicit LogMaker(std::string path) : path_(std::move(path)) {}

  Status Take(std::string_view bytes) {
    SHIFTMAP_ASSIGN_OR_RETURN(const JournalRecord record, DecodeJournalRecord(bytes));
    return std::visit([&](const auto& item) { return Apply(item); }, record);
  }

  Status Finish() {
    if (order_) {
      order_->FlushPaused();
      SHIFTMAP_RETURN_IF_ERROR(WriteDue());
    }
    return writer_ && writer_->has_odometry() ? writer_->Finish() : OkStatus();
  }

 private:
  Status Apply(const ShiftHeader& header) {
    if (writer_) return InvalidArgument("another header");
    const RunInfo info{header.vehicle, "shiftmap-localizer serve", header.uuid, header.area};
    SHIFTMAP_ASSIGN_OR_RETURN(writer_, RunLogWriter::Create(path_, info));
    if (header.max_delay_s > 0.0) order_.emplace(FromSeconds(header.max_delay_s));
    return OkStatus();
  }

  Status Apply(const InitializePose&) { return OkStatus(); }

  Status Apply(const RunEvent& item) {
    if (!writer_) return InvalidArgument("no header, expected one first");
    if (!order_) return writer_->Write(item);
    order_->Add(item);
    return WriteDue();
  }

  Status WriteDue() {
    while (const HeldEvent* const event = order_->Next()) {
      SHIFTMAP_RETURN_IF_ERROR(
          event->Visit([&](const auto& item) { return writer_->Write(item); }));
    }
    return OkStatus();
  }

  std::string path_;
  std::optional<RunLogWriter> writer_;
  std::optional<EventBuffer> order_;
};

// A file of a shift: `<uuid><ending>`.
struct ShiftFile {
  fs::file_time_type written;
  fs::path path;
  std::int64_t bytes = 0;
};

// Sorted by modification time. Files that cannot be read are skipped.
std::vector<ShiftFile> FilesOf(const std::string& folder, std::string_view ending) {
  std::vector<ShiftFile> files;
  std::error_code error;
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    const std::string name = at->path().filename().string();
    if (name.size() != kUuidLength + ending.size() || !name.ends_with(ending)) continue;
    std::error_code unread;
    ShiftFile file{at->last_write_time(unread), at->path(), 0};
    if (unread) continue;
    file.bytes = static_cast<std::int64_t>(at->file_size(unread));
    if (!unread) files.push_back(std::move(file));
  }
  std::sort(files.begin(), files.end(), [](const ShiftFile& a, const ShiftFile& b) {
    return std::tie(a.written, a.path) < std::tie(b.written, b.path);
  });
  return files;
}

// Logs leave as much of the disk free as they take: a report must find room.
void DeleteOldest(const std::string& folder, std::int64_t max_bytes) {
  const std::vector<ShiftFile> logs = FilesOf(folder, kLog);
  std::int64_t total = 0;
  for (const ShiftFile& log : logs) total += log.bytes;
  std::error_code unknown;
  const fs::space_info disk = fs::space(folder, unknown);
  if (!unknown) {
    max_bytes = std::min(max_bytes, (static_cast<std::int64_t>(disk.available) + total) / 2);
  }
  for (const ShiftFile& log : logs) {
    if (total <= max_bytes) return;
    std::error_code error;
    if (fs::remove(log.path, error)) total -= log.bytes;
  }
}

// What a shift lacks because of an error.
Status Lacks(const Status& status, const char* what) {
  if (status.ok()) return status;
  return MakeStatus(status.code(), "{}, the shift has no {}", Message(status), what);
}

bool GiveEnding(const char* ending, fs::path* journal) {
  fs::path renamed = *journal;
  renamed.replace_extension(ending);
  if (std::rename(journal->c_str(), renamed.c_str()) != 0) return false;
  *journal = renamed;
  return true;
}

void DeleteAll(const std::string& folder, const char* ending) {
  for (const ShiftFile& file : FilesOf(folder, ending)) unlink(file.path.c_str());
}

Status MakeLog(const std::string& folder,
               const fs::path& journal,
               std::int64_t max_bytes,
               bool records) {
  DeleteOldest(folder, max_bytes);
  fs::path log = journal;
  log.replace_extension(kLog);
  SHIFTMAP_RETURN_IF_ERROR(Lacks(WriteShiftLog(journal.string(), log.string()), "run log"));
  fs::path done = journal;
  if (!records || !GiveEnding(kUnrecorded, &done)) unlink(journal.c_str());
  DeleteOldest(folder, max_bytes);
  return OkStatus();
}

// The evidence is in the report and the items are in the log: a journal that makes no recording is
// not kept for that.
Status MakeRecording(const ShiftRecordings& recordings,
                     fs::path journal,
                     const std::atomic<bool>& stop) {
  // The step comes first. If that cannot be had, the thread has the priority of the others.
  (void)setpriority(PRIO_PROCESS, static_cast<id_t>(syscall(SYS_gettid)), kLowestPriority);
  DeleteOldest(recordings.folder, recordings.max_bytes);
  const fs::path path = fs::path(recordings.folder) / (journal.stem().string() + std::string(kLog));
  GiveEnding(kRecording, &journal);
  const Status status = recordings.make(journal.string(), path.string(), stop);
  if (status.code() == StatusCode::kAborted && GiveEnding(kUnrecorded, &journal)) return OkStatus();
  unlink(journal.c_str());
  DeleteOldest(recordings.folder, recordings.max_bytes);
  return Lacks(status, "recording");
}

}  // namespace

Status WriteShiftLog(const std::string& journal, const std::string& log) {
  LogMaker maker(log);
  SHIFTMAP_RETURN_IF_ERROR(
      ReadJournal(journal, [&](std::string_view bytes) { return maker.Take(bytes); }).status());
  return maker.Finish();
}

ShiftLogs::ShiftLogs(std::string folder, std::int64_t max_bytes, ShiftRecordings recordings)
    : folder_(std::move(folder)), max_bytes_(max_bytes), recordings_(std::move(recordings)) {
  DeleteAll(folder_, kRecording);
  if (!records()) DeleteAll(folder_, kUnrecorded);
}

Status ShiftLogs::Take(const std::string& journal, const std::string& uuid) {
  if (max_bytes_ == 0 && !records()) {
    unlink(journal.c_str());
    return OkStatus();
  }
  const std::string waiting = folder_ + "/" + uuid + (max_bytes_ > 0 ? kWaiting : kUnrecorded);
  if (std::rename(journal.c_str(), waiting.c_str()) == 0) {
    waiting_ = true;
    return StepCallback();
  }
  if (errno == ENOENT) return OkStatus();  // It was set aside.
  const Status status =
      Unavailable("journal '{}': cannot rename: {}", journal, std::strerror(errno));
  unlink(journal.c_str());
  return Lacks(status, "run log");
}

std::string ShiftLogs::NextJournal(const char* ending) {
  for (const ShiftFile& journal : FilesOf(folder_, ending)) {
    if (tried_.insert(journal.path.string()).second) return journal.path.string();
  }
  return "";
}

Status ShiftLogs::Begin(bool ending) {
  Status before = OkStatus();
  if (making_.valid()) {
    if (making_.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return before;
    before = making_.get();
  }
  if (!waiting_) return before;
  waiting_ = false;
  std::function<Status()> make;
  std::string journal = max_bytes_ > 0 ? NextJournal(kWaiting) : "";
  if (!journal.empty()) {
    make = [folder = folder_, journal, max_bytes = max_bytes_, records = records()] {
      return MakeLog(folder, journal, max_bytes, records);
    };
  } else if (records() && !ending) {
    journal = NextJournal(kUnrecorded);
    make = [recordings = recordings_, journal, stop = stop_] {
      return MakeRecording(recordings, journal, *stop);
    };
  }
  if (journal.empty()) return before;
  waiting_ = true;
  try {
    making_ = std::async(std::launch::async, make);
  } catch (const std::system_error&) {  // The process may have no more threads.
    tried_.erase(journal);
  }
  return before;
}

ShiftLogs::~ShiftLogs() {
  if (stop_) *stop_ = true;
}

Status ShiftLogs::Finish() {
  *stop_ = true;
  Status first = OkStatus();
  do {
    if (making_.valid()) making_.wait();
    const Status status = Begin(true);
    if (first.ok()) first = status;
  } while (making_.valid());
  return first;
}

}  // namespace shiftmap::live
