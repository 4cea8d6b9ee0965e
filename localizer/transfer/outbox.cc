// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/outbox.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <system_error>
#include <tuple>

#include "mapstore/core/atomic_file.h"
#include "mapstore/core/clock.h"
#include "mapstore/core/input_file.h"
#include "mapstore/core/lock_file.h"

namespace shiftmap::transfer {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

constexpr std::size_t kUuidLength = 36;
constexpr std::size_t kMaxRecordBytes = std::size_t{64} << 20;
constexpr std::array kStates = {
    OutboxState::kWaiting, OutboxState::kAcknowledged, OutboxState::kRefused, OutboxState::kLost};

bool IsShiftFile(const std::string& name) {
  return name.size() > kUuidLength && name[0] != '.' &&
         (name.substr(kUuidLength) == ".report" || name.substr(kUuidLength) == ".mcap");
}

// Nothing if there is no regular file of this name.
std::optional<OutboxItem> Look(const std::string& folder, const std::string& name) {
  struct stat info {};
  if (lstat((folder + "/" + name).c_str(), &info) != 0 || !S_ISREG(info.st_mode)) {
    return std::nullopt;
  }
  OutboxItem item;
  item.name = name;
  item.bytes = info.st_size;
  item.written_ns = std::int64_t{info.st_mtim.tv_sec} * 1'000'000'000 + info.st_mtim.tv_nsec;
  item.since_ns = ToNanoseconds(SystemNow());
  return item;
}

Json ToJson(const OutboxItem& item) {
  Json json{{"name", item.name},
            {"state", ToString(item.state)},
            {"bytes", item.bytes},
            {"written_ns", item.written_ns},
            {"since_ns", item.since_ns}};
  if (!item.reason.empty()) json["reason"] = item.reason;
  return json;
}

OutboxItem FromJson(const Json& json) {
  OutboxItem item;
  item.name = json.at("name").get<std::string>();
  item.bytes = json.at("bytes").get<std::int64_t>();
  item.written_ns = json.at("written_ns").get<std::int64_t>();
  item.since_ns = json.at("since_ns").get<std::int64_t>();
  item.reason = json.value("reason", "");
  const auto state = json.at("state").get<std::string>();
  for (const OutboxState candidate : kStates) {
    if (state == ToString(candidate)) item.state = candidate;
  }
  return item;
}

bool HasFile(const OutboxItem& item) {
  return item.state == OutboxState::kWaiting || item.state == OutboxState::kRefused;
}

bool OlderFirst(const OutboxItem& a, const OutboxItem& b) {
  return std::tie(a.written_ns, a.name) < std::tie(b.written_ns, b.name);
}

}  // namespace

const char* ToString(OutboxState state) {
  switch (state) {
    case OutboxState::kWaiting:
      return "waiting";
    case OutboxState::kAcknowledged:
      return "acknowledged";
    case OutboxState::kRefused:
      return "refused";
    case OutboxState::kLost:
      return "lost";
  }
  return "";
}

StatusOr<Outbox> Outbox::Open(const OutboxOptions& options) {
  StatusOr<std::optional<OwnedFd>> lock = LockFile(options.record + "/outbox.lock");
  SHIFTMAP_RETURN_IF_ERROR(Annotate(lock.status(), "outbox '{}'", options.record));
  if (!*lock) return Unavailable("outbox '{}': another process has it", options.record);
  Outbox outbox(options, **std::move(lock));
  SHIFTMAP_RETURN_IF_ERROR(outbox.Load());
  return outbox;
}

Status Outbox::Load() {
  const std::string path = options_.record + "/outbox.json";
  std::error_code unknown;
  if (!fs::exists(path, unknown)) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string text, ReadInputFile("outbox", path, kMaxRecordBytes));
  try {
    const Json document = Json::parse(text);
    for (const Json& json : document.at("items")) {
      OutboxItem item = FromJson(json);
      if (IsShiftFile(item.name)) items_[item.name] = std::move(item);
    }
  } catch (const Json::exception& error) {
    // To hand a file in once more does no harm, and to hand in none does.
    items_.clear();
    std::rename(path.c_str(), (path + ".damaged").c_str());
    if (options_.warn) {
      options_.warn(fmt::format("outbox '{}' is damaged, and begun anew: {}", path, error.what()));
    }
  }
  return OkStatus();
}

Status Outbox::Save() {
  ForgetOldest();
  Json list = Json::array();
  for (const auto& [name, item] : items_) list.push_back(ToJson(item));
  return WriteFileAtomically(
      options_.record + "/outbox.json",
      Json{{"items", list}}.dump(1, ' ', false, Json::error_handler_t::replace) + "\n");
}

// Of those whose file is gone.
void Outbox::ForgetOldest() {
  if (items_.size() <= options_.max_items) return;
  std::vector<OutboxItem> gone;
  for (const auto& [name, item] : items_) {
    if (!HasFile(item)) gone.push_back(item);
  }
  std::sort(gone.begin(), gone.end(), [](const OutboxItem& a, const OutboxItem& b) {
    return std::make_tuple(a.state != OutboxState::kAcknowledged, a.since_ns) <
           std::make_tuple(b.state != OutboxState::kAcknowledged, b.since_ns);
  });
  const std::size_t excess = std::min(gone.size(), items_.size() - options_.max_items);
  for (std::size_t i = 0; i < excess; ++i) items_.erase(gone[i].name);
}

Status Outbox::Scan() {
  bool changed = false;
  std::error_code error;
  for (fs::directory_iterator at(options_.files, error), end; !error && at != end;
       at.increment(error)) {
    const std::string name = at->path().filename().string();
    if (!IsShiftFile(name)) continue;
    std::optional<OutboxItem> found = Look(options_.files, name);
    if (!found) continue;
    const auto known = items_.find(name);
    // One that was written again is another one.
    if (known != items_.end() && known->second.bytes == found->bytes &&
        known->second.written_ns == found->written_ns &&
        known->second.state != OutboxState::kLost) {
      if (known->second.state == OutboxState::kAcknowledged) unlink(PathOf(name).c_str());
      continue;
    }
    items_[name] = *std::move(found);
    changed = true;
  }
  if (error) {
    return MakeStatus(error == std::errc::no_such_file_or_directory ? StatusCode::kNotFound
                                                                    : StatusCode::kUnavailable,
                      "folder '{}': {}",
                      options_.files,
                      error.message());
  }
  for (const auto& [name, item] : items_) {
    if (!HasFile(item) || Look(options_.files, name)) continue;
    if (item.state == OutboxState::kWaiting && options_.warn) {
      options_.warn(fmt::format("'{}' is gone before it was handed in", PathOf(name)));
    }
    Mark(name, OutboxState::kLost, "the file was deleted by somebody else");
    changed = true;
  }
  if (changed) SHIFTMAP_RETURN_IF_ERROR(Save());
  return ApplyBound();
}

Status Outbox::ApplyBound() {
  std::int64_t total = 0;
  std::vector<OutboxItem> files;
  for (const auto& [name, item] : items_) {
    if (!HasFile(item)) continue;
    total += item.bytes;
    files.push_back(item);
  }
  const auto rank = [](const OutboxItem& item) {
    return item.state == OutboxState::kRefused ? 0 : item.is_report() ? 2 : 1;
  };
  std::sort(files.begin(), files.end(), [&](const OutboxItem& a, const OutboxItem& b) {
    return rank(a) != rank(b) ? rank(a) < rank(b) : OlderFirst(a, b);
  });
  const std::string reason = fmt::format("the folder may take {} MiB", options_.max_bytes >> 20);
  std::size_t excess = 0;
  for (; excess < files.size() && total > options_.max_bytes; ++excess) {
    Mark(files[excess].name, OutboxState::kLost, reason);
    total -= files[excess].bytes;
  }
  if (excess == 0) return OkStatus();
  SHIFTMAP_RETURN_IF_ERROR(Save());
  files.resize(excess);
  for (const OutboxItem& item : files) {
    unlink(PathOf(item.name).c_str());
    if (options_.warn) {
      options_.warn(fmt::format(
          "'{}', {}, is deleted: {}",
          PathOf(item.name),
          item.state == OutboxState::kRefused ? "which was refused" : "which was not handed in",
          reason));
    }
  }
  return OkStatus();
}

std::vector<OutboxItem> Outbox::Waiting() const {
  std::vector<OutboxItem> waiting;
  for (const auto& [name, item] : items_) {
    if (item.state == OutboxState::kWaiting) waiting.push_back(item);
  }
  std::sort(waiting.begin(), waiting.end(), [](const OutboxItem& a, const OutboxItem& b) {
    return a.is_report() != b.is_report() ? a.is_report() : OlderFirst(a, b);
  });
  return waiting;
}

void Outbox::Mark(const std::string& name, OutboxState state, const std::string& reason) {
  OutboxItem& item = items_[name];
  item.name = name;
  item.state = state;
  item.reason = reason;
  item.since_ns = ToNanoseconds(SystemNow());
}

Status Outbox::Change(const std::string& name, OutboxState state, const std::string& reason) {
  Mark(name, state, reason);
  return Save();
}

Status Outbox::Acknowledge(const std::string& name) {
  SHIFTMAP_RETURN_IF_ERROR(Change(name, OutboxState::kAcknowledged, ""));
  if (unlink(PathOf(name).c_str()) == 0 || errno == ENOENT) return OkStatus();
  return Unavailable("'{}': cannot be deleted: {}", PathOf(name), std::strerror(errno));
}

Status Outbox::Refuse(const std::string& name, const std::string& reason) {
  return Change(name, OutboxState::kRefused, reason);
}

Status Outbox::ForgetRefusals() {
  for (auto& [name, item] : items_) {
    if (item.state != OutboxState::kRefused) continue;
    item.state = OutboxState::kWaiting;
    item.reason.clear();
  }
  return Save();
}

}  // namespace shiftmap::transfer
