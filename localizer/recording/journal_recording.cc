// SPDX-License-Identifier: Apache-2.0
#include "localizer/recording/journal_recording.h"

#include <optional>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "localizer/live/codec/journal_codec.h"
#include "localizer/live/journal_file.h"
#include "localizer/live/shift.h"
#include "localizer/recording/shift_recorder.h"

namespace shiftmap {
namespace {

using MapOfShift = std::function<StatusOr<MapSnapshot>(const live::ShiftHeader&)>;

class JournalRecorder {
 public:
  JournalRecorder(MapOfShift map_of,
                  std::string software,
                  std::string path,
                  const std::atomic<bool>& stop)
      : map_of_(std::move(map_of)),
        software_(std::move(software)),
        path_(std::move(path)),
        stop_(stop) {}

  Status Take(std::string_view bytes) {
    if (stop_) return MakeStatus(StatusCode::kAborted, "stopped");
    SHIFTMAP_ASSIGN_OR_RETURN(const live::JournalRecord record, live::DecodeJournalRecord(bytes));
    if (std::holds_alternative<live::ShiftHeader>(record) == shift_.has_value()) {
      return InvalidArgument("expected one header, first");
    }
    return std::visit([&](const auto& item) { return Apply(item); }, record);
  }

  Status Finish() {
    if (!recorder_) return OkStatus();
    events_.clear();
    shift_->LocalizeHeld(&events_);
    SHIFTMAP_RETURN_IF_ERROR(recorder_->Record(shift_->localizer()));
    return recorder_->Finish();
  }

 private:
  Status Apply(const live::ShiftHeader& header) {
    SHIFTMAP_RETURN_IF_ERROR(live::Shift::OptionsOf(header).Validate());
    SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, map_of_(header));
    if (map.content_hash() != header.content_hash) {
      return FailedPrecondition(
          "map: content hash {}, expected {}", map.content_hash(), header.content_hash);
    }
    shift_.emplace(map, header);
    return OkStatus();
  }

  Status Apply(const live::InitializePose& start) {
    shift_->Initialize(start.pose);
    return OkStatus();
  }

  Status Apply(const RunEvent& item) {
    if (!recorder_) {
      RecordedShift shift;
      shift.vehicle = shift_->header().vehicle;
      shift.run_uuid = shift_->header().uuid;
      shift.software = software_;
      SHIFTMAP_ASSIGN_OR_RETURN(
          recorder_,
          ShiftRecorder::Create(path_, shift, shift_->localizer().snapshot(), StampOf(item)));
    }
    events_.clear();
    SHIFTMAP_RETURN_IF_ERROR(shift_->Process(item, &events_));
    return recorder_->Record(shift_->localizer());
  }

  MapOfShift map_of_;
  std::string software_;
  std::string path_;
  const std::atomic<bool>& stop_;
  std::optional<live::Shift> shift_;
  std::optional<ShiftRecorder> recorder_;
  std::vector<live::Event> events_;  // Nobody is told again.
};

}  // namespace

Status RecordJournal(const std::string& journal,
                     const MapOfShift& map_of,
                     const std::string& software,
                     const std::string& path,
                     const std::atomic<bool>& stop) {
  JournalRecorder recorder(map_of, software, path, stop);
  SHIFTMAP_RETURN_IF_ERROR(live::ReadJournal(journal, [&](std::string_view bytes) {
                             return recorder.Take(bytes);
                           }).status());
  return recorder.Finish();
}

}  // namespace shiftmap
