// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/night_lock.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <string_view>
#include <system_error>

#include "mapstore/core/clock.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/core/lock_file.h"
#include "mapstore/core/parse_whole.h"

namespace shiftmap {

StatusOr<NightLock> NightLock::Take(const std::string& store) {
  std::string path = store + ".nightly";
  SHIFTMAP_ASSIGN_OR_RETURN(std::optional<OwnedFd> file, LockFile(path));
  if (!file) return Unavailable("map store '{}': another night is under way", store);
  return NightLock(*std::move(file), std::move(path));
}

StatusOr<std::optional<Stamp>> NightLock::Begin(Stamp begin) {
  std::array<char, 32> text;
  const ssize_t size = pread(file_.get(), text.data(), text.size(), 0);
  const auto before = ParseWhole<std::int64_t>(
      std::string_view(text.data(), static_cast<std::size_t>(std::max<ssize_t>(0, size))));
  // The file keeps the begin of the first that was interrupted.
  if (before) return StampFromNanoseconds(*before);
  const std::string now = fmt::format("{}", ToNanoseconds(begin));
  if (ftruncate(file_.get(), 0) != 0 ||
      pwrite(file_.get(), now.data(), now.size(), 0) != std::ssize(now) ||
      fdatasync(file_.get()) != 0) {
    return Unavailable(
        "'{}': cannot be written: {}", path_, std::generic_category().message(errno));
  }
  return std::nullopt;
}

void NightLock::End() {
  // What is left of a night that ended is another line on the next page, and no harm.
  if (ftruncate(file_.get(), 0) == 0) fdatasync(file_.get());
}

StatusOr<std::vector<std::string>> NameUnreported(MapStore& store, Stamp interrupted, Stamp begin) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      const std::vector<AuditEntry> entries,
      store.AuditLog(std::nullopt, {AuditAction::kPublish, AuditAction::kRefuse}));
  std::vector<std::string> lines;
  for (const AuditEntry& entry : entries) {
    if (entry.written < interrupted || entry.written >= begin) continue;
    lines.push_back(fmt::format(
        "area '{}': version {} was {} since the night of {} UTC, which was interrupted, and is on "
        "no page",
        InertLine(entry.area),
        entry.subject.substr(0, entry.subject.find(' ')),
        entry.Is(AuditAction::kPublish) ? "published" : "refused",
        FormatUtc(interrupted)));
  }
  return lines;
}

}  // namespace shiftmap
