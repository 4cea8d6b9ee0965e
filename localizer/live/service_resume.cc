// SPDX-License-Identifier: Apache-2.0
//
// How a service takes up a shift that a crash interrupted.
#include <unistd.h>

#include <cstdio>
#include <utility>

#include "localizer/live/codec/journal_codec.h"
#include "localizer/live/service.h"
#include "mapstore/codec/shift_report.h"

namespace shiftmap::live {
namespace {

constexpr std::uint64_t kRecordsPerSign = 1000;

// Applies the records of a journal, in order, to the shift that the first of them begins.
class Replay {
 public:
  Replay(const ServiceOptions& options,
         std::optional<MapSnapshot>* map,
         std::optional<Shift>* shift)
      : options_(options), map_(map), shift_(shift) {}

  Status Take(std::string_view bytes) {
    if (count_++ % kRecordsPerSign == 0 && options_.resuming) options_.resuming();
    SHIFTMAP_ASSIGN_OR_RETURN(const JournalRecord record, DecodeJournalRecord(bytes));
    const bool is_header = std::holds_alternative<ShiftHeader>(record);
    if (is_header == shift_->has_value()) {
      return InvalidArgument("{} header, expected one, first", is_header ? "another" : "no");
    }
    return std::visit([&](const auto& item) { return Apply(item); }, record);
  }

  bool has_start() const { return has_start_; }

 private:
  // The journal counts on the very map that the shift was begun on, not on today's.
  Status Apply(const ShiftHeader& header) {
    SHIFTMAP_RETURN_IF_ERROR(Shift::OptionsOf(header).Validate());
    const MapSnapshot& now = **map_;
    const bool same = now.area() == header.area && now.content_hash() == header.content_hash &&
                      now.stamp() == header.map_stamp;
    if (!same) {
      SHIFTMAP_ASSIGN_OR_RETURN(
          MapSnapshot then,
          LoadLiveMap(options_.map_path, header.area, header.version, header.map_stamp));
      if (then.content_hash() != header.content_hash) {
        return FailedPrecondition("area '{}' version {}: content hash {}, expected {}",
                                  header.area,
                                  header.version.value(),
                                  then.content_hash(),
                                  header.content_hash);
      }
      *map_ = std::move(then);
    }
    shift_->emplace(**map_, header);
    return OkStatus();
  }

  Status Apply(const InitializePose& start) {
    (*shift_)->Initialize(start.pose);
    has_start_ = true;
    return OkStatus();
  }

  Status Apply(const RunEvent& item) {
    has_start_ = true;
    events_.clear();
    return (*shift_)->Process(item, &events_);
  }

  const ServiceOptions& options_;
  std::optional<MapSnapshot>* map_;
  std::optional<Shift>* shift_;
  std::vector<Event> events_;
  std::uint64_t count_ = 0;
  bool has_start_ = false;
};

}  // namespace

Status Service::Resume() {
  const std::string path = File("shift.journal");
  std::optional<MapSnapshot> map = map_;
  std::optional<Shift> shift;
  Replay replay(options_, &map, &shift);
  SHIFTMAP_ASSIGN_OR_RETURN(const JournalEnd end, ReadJournal(path, [&](std::string_view bytes) {
                              return replay.Take(bytes);
                            }));
  if (end.cut_bytes > 0) {
    options_.warn(fmt::format(
        "journal '{}': the last {} bytes are no whole record, cut off", path, end.cut_bytes));
  }
  if (!shift) {
    // It was interrupted before it began.
    unlink(path.c_str());
    return OkStatus();
  }
  SHIFTMAP_ASSIGN_OR_RETURN(journal_, JournalFile::Resume(path, end.whole_bytes));
  map_ = std::move(map);
  shift_ = std::move(shift);
  start_chosen_ = replay.has_start();
  resumed_ = true;
  last_uuid_ = shift_->header().uuid;
  HoldUntilNextItem();
  return OkStatus();
}

void Service::SetJournalAside(const Status& why) {
  const std::string path = File("shift.journal");
  const std::string aside = File(fmt::format("interrupted-{}.journal", RandomUuid()));
  options_.warn(fmt::format("{}: not resumed, kept as '{}'", Message(why), aside));
  std::rename(path.c_str(), aside.c_str());
}

}  // namespace shiftmap::live
