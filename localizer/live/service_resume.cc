// SPDX-License-Identifier: Apache-2.0
//
// How a service takes up a shift that a crash interrupted.
#include <unistd.h>

#include <cstdio>
#include <functional>
#include <utility>

#include "localizer/live/codec/journal_codec.h"
#include "localizer/live/service.h"
#include "mapstore/codec/shift_report.h"

namespace shiftmap::live {
namespace {

constexpr std::uint64_t kRecordsPerSign = 1000;
constexpr std::uint64_t kRecordsPerMark = 10'000;  // Some seconds of replay.
constexpr int kMaxFailures = 2;

using MapOfShift = std::function<StatusOr<const MapSnapshot*>(const ShiftHeader&)>;

// Applies the records of a journal, in order, to the shift that the first of them begins.
class Replay {
 public:
  Replay(const ServiceOptions& options,
         const ResumeMark& mark,
         MapOfShift map_of,
         std::optional<Shift>* shift)
      : options_(options), mark_(mark), map_of_(std::move(map_of)), shift_(shift) {}

  Status Take(std::string_view bytes) {
    if (count_ % kRecordsPerMark == 0) Reach(count_);
    if (count_++ % kRecordsPerSign == 0 && options_.resuming) options_.resuming();
    SHIFTMAP_ASSIGN_OR_RETURN(const JournalRecord record, DecodeJournalRecord(bytes));
    const bool is_header = std::holds_alternative<ShiftHeader>(record);
    if (is_header == shift_->has_value()) {
      return InvalidArgument("{} header, expected one, first", is_header ? "another" : "no");
    }
    return std::visit([&](const auto& item) { return Apply(item); }, record);
  }

  // Localizes the held items and makes the report, on a copy of the shift: the first steps after
  // the replay, which must not end the process either.
  void Rehearse() {
    Reach(count_);
    if (options_.resuming) options_.resuming();
    Shift copy = **shift_;
    events_.clear();
    copy.LocalizeHeld(&events_);
    copy.Report(DropCounts());
  }

  bool has_start() const { return has_start_; }

 private:
  // Without a note the replay is only not counted.
  void Reach(std::uint64_t record) {
    if (const Status status = mark_.Reach(record); !status.ok()) options_.warn(Message(status));
  }

  // The journal counts on the very map that the shift was begun on, not on today's.
  Status Apply(const ShiftHeader& header) {
    SHIFTMAP_RETURN_IF_ERROR(Shift::OptionsOf(header).Validate());
    SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot* map, map_of_(header));
    if (map->content_hash() != header.content_hash) {
      return FailedPrecondition("area '{}' version {}: content hash {}, expected {}",
                                header.area,
                                header.version.value(),
                                map->content_hash(),
                                header.content_hash);
    }
    shift_->emplace(*map, header);
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
  const ResumeMark& mark_;
  MapOfShift map_of_;
  std::optional<Shift>* shift_;
  std::vector<Event> events_;
  std::uint64_t count_ = 0;
  bool has_start_ = false;
};

// The file of a folder on which a shift began.
StatusOr<FolderMap> FileOf(const MapFolder& folder, const ShiftHeader& header) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<FolderMap> files, folder.List());
  for (const FolderMap& file : files) {
    if (file.sha256 == header.map_sha256) return file;
  }
  return NotFound("map folder '{}': no file with hash '{}', on which the shift began",
                  folder.path(),
                  header.map_sha256);
}

}  // namespace

bool Service::IsMapOf(const ShiftHeader& header) const {
  if (!map_ || (map_->file && map_->file->sha256 != header.map_sha256)) return false;
  const MapSnapshot& map = map_->map;
  return map.area() == header.area && map.content_hash() == header.content_hash &&
         map.stamp() == header.map_stamp;
}

StatusOr<Service::LoadedMap> Service::LoadedOf(const ShiftHeader& header) {
  if (!fleet_.has_folder()) {
    SHIFTMAP_ASSIGN_OR_RETURN(MapSnapshot map, LoadMapOfShift(options_, header));
    return LoadedMap{std::move(map)};
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const MapFolder* folder, fleet_.Folder());
  SHIFTMAP_ASSIGN_OR_RETURN(const FolderMap file, FileOf(*folder, header));
  SHIFTMAP_ASSIGN_OR_RETURN(MapUse use, folder->Use(file));
  SHIFTMAP_ASSIGN_OR_RETURN(MapSnapshot map,
                            LoadLiveMap(file.path, header.area, header.version, header.map_stamp));
  return LoadedMap{std::move(map), file, std::move(use)};
}

StatusOr<MapSnapshot> LoadMapOfShift(const ServiceOptions& options, const ShiftHeader& header) {
  if (options.map_folder.empty()) {
    return LoadLiveMap(options.map_path, header.area, header.version, header.map_stamp);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const MapFolder folder, MapFolder::Open(options.map_folder));
  SHIFTMAP_ASSIGN_OR_RETURN(const FolderMap file, FileOf(folder, header));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapUse use, folder.Use(file));
  return LoadLiveMap(file.path, header.area, header.version, header.map_stamp);
}

// An attempt has succeeded once the replay and the rehearsal are through. A process that ends
// later, for whatever reason, resumes again.
void Service::TakeUpJournal() {
  if (access(File(kJournal).c_str(), F_OK) != 0) return;
  const ResumeMark mark(File(kResumeMark));
  if (mark.failures() >= kMaxFailures) {
    BeginInsteadOf(mark);
  } else if (const Status status = Resume(mark); !status.ok()) {
    SetJournalAside(status);
  }
  mark.Clear();
}

Status Service::Resume(const ResumeMark& mark) {
  const std::string path = File(kJournal);
  std::optional<LoadedMap> other;  // If it is not today's.
  const auto map_of = [&](const ShiftHeader& header) -> StatusOr<const MapSnapshot*> {
    if (IsMapOf(header)) return &map_->map;
    SHIFTMAP_ASSIGN_OR_RETURN(other, LoadedOf(header));
    return &other->map;
  };
  std::optional<Shift> shift;
  Replay replay(options_, mark, map_of, &shift);
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
  replay.Rehearse();
  SHIFTMAP_ASSIGN_OR_RETURN(journal_, JournalFile::Resume(path, end.whole_bytes));
  if (other) TakeUp(*std::move(other));
  shift_ = std::move(shift);
  start_chosen_ = replay.has_start();
  resumed_ = true;
  last_uuid_ = shift_->header().uuid;
  HoldUntilNextItem();
  options_.inform(fmt::format("shift {} of vehicle '{}' goes on after {} records of its journal",
                              last_uuid_,
                              shift_->header().vehicle,
                              end.records));
  return OkStatus();
}

// The vehicle drives, and its driver goes on sending items: without a shift all would be refused.
void Service::BeginInsteadOf(const ResumeMark& mark) {
  Start start;
  // An error only ends the reading.
  (void)ReadJournal(File(kJournal), [&](std::string_view bytes) -> Status {
    SHIFTMAP_ASSIGN_OR_RETURN(const JournalRecord record, DecodeJournalRecord(bytes));
    if (const auto* header = std::get_if<ShiftHeader>(&record)) start.vehicle = header->vehicle;
    return InvalidArgument("the first record is enough");
  });
  SetJournalAside(Internal("journal '{}': taking it up ended the process {} times at one place",
                           File(kJournal),
                           mark.failures()));
  std::vector<Event> ignored;
  if (const Status status = Do(start, &ignored); !status.ok()) options_.warn(Message(status));
}

void Service::SetJournalAside(const Status& why) {
  const std::string aside = File(fmt::format("interrupted-{}.journal", RandomUuid()));
  options_.warn(fmt::format("{}: the journal is kept as '{}'", Message(why), aside));
  std::rename(File(kJournal).c_str(), aside.c_str());
}

}  // namespace shiftmap::live
