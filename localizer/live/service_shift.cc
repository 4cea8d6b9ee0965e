// SPDX-License-Identifier: Apache-2.0
//
// How a shift of a service begins and ends.
#include <unistd.h>

#include <utility>

#include "localizer/live/codec/journal_codec.h"
#include "localizer/live/saved_pose.h"
#include "localizer/live/service.h"
#include "mapstore/codec/shift_report.h"

namespace shiftmap::live {
namespace {

constexpr const char* kSavedPose = "pose";

// A disk that did not take a report is tried again after this.
constexpr std::chrono::seconds kRetryAfter(1);

}  // namespace

Status Service::Do(const Start& start, std::vector<Event>*) {
  if (shift_) {
    return FailedPrecondition("shift {} is under way, expected a stop first",
                              shift_->header().uuid);
  }
  if (fleet_.has_folder()) SHIFTMAP_RETURN_IF_ERROR(TakeUpEnabledMap());
  ShiftHeader header = NewHeader(start.vehicle.empty() ? options_.vehicle : start.vehicle);
  header.odometer_m = start.odometer_m;
  return BeginShift(header);
}

ShiftHeader Service::NewHeader(const std::string& vehicle) const {
  const MapSnapshot& map = map_->map;
  ShiftHeader header;
  header.uuid = RandomUuid();
  header.vehicle = vehicle;
  header.area = map.area();
  header.version = map.version();
  header.content_hash = map.content_hash();
  header.map_stamp = map.stamp();
  header.alpha = options_.localizer.hypotheses.alpha;
  header.max_leaves = options_.localizer.hypotheses.max_leaves;
  header.max_delay_s = options_.localizer.max_delay_s;
  header.limits = options_.localizer.limits;
  header.field_of_view = options_.localizer.hypotheses.field_of_view.model;
  if (map_->file) header.map_sha256 = map_->file->sha256;
  return header;
}

Status Service::BeginShift(const ShiftHeader& header) {
  SHIFTMAP_ASSIGN_OR_RETURN(journal_, JournalFile::Create(File(kJournal)));
  ResumeMark(File(kResumeMark)).Clear();
  journal_->Append(EncodeJournalRecord(header));
  shift_.emplace(map_->map, header);
  time_line_ = TimeLineWatch(FromSeconds(kMaxRefusedS));
  start_chosen_ = false;
  resumed_ = false;
  implausible_warned_ = false;
  journal_warnings_.clear();
  dropped_ = DropCounts();
  overruns_ = 0;
  last_uuid_ = header.uuid;
  if (given_start_) InitializeShift(*given_start_);
  CheckJournal(journal_->Sync());
  options_.inform(fmt::format("shift {} of vehicle '{}' begins on area '{}' version {}",
                              header.uuid,
                              header.vehicle,
                              header.area,
                              header.version.value()));
  return OkStatus();
}

void Service::ChooseStart(Stamp now) {
  start_chosen_ = true;
  const std::string path = File(kSavedPose);
  const auto saved = ReadSavedPose(path);
  // From here on the vehicle may be anywhere else.
  unlink(path.c_str());
  if (!saved.ok()) {
    if (saved.status().code() != StatusCode::kNotFound) options_.warn(Message(saved.status()));
    return;
  }
  if (given_start_) return;
  const auto start =
      UsableStart(*saved, map_->map, now, shift_->header().odometer_m, options_.max_pose_age_s);
  if (start.ok()) {
    InitializeShift(*start);
  } else {
    options_.warn(Message(start.status()) + ", not used");
  }
}

void Service::InitializeShift(const PoseWithCovariance& pose) {
  shift_->Initialize(pose);
  journal_->Append(EncodeJournalRecord(InitializePose{pose}));
}

// A disk that is full is waited for. A report that no reader would accept is a bug of ours: the
// journal is kept for whoever mends it, and the vehicle's next shift does not wait for that.
Status Service::WriteReport() {
  ShiftReport report = shift_->Report(dropped_);
  report.software = options_.software;
  // Without an item there is no time but the host's.
  if (report.end == Stamp()) report.begin = report.end = options_.clock();
  const std::string path = File(report.uuid + ".report");
  const Status status = WriteShiftReport(report, path);
  if (status.ok()) {
    last_report_ = path;
  } else if (status.code() == StatusCode::kInvalidArgument) {
    last_report_.clear();
    WriteJournal();
    SetJournalAside(status);
  } else {
    return MakeStatus(StatusCode::kUnavailable, "{}", Message(status));
  }
  return OkStatus();
}

// The pose of a vehicle that may move says nothing of where the next shift begins.
void Service::SavePose() {
  if (!shift_->Stands()) {
    options_.warn("odometry does not say that the vehicle stands, its pose was not saved");
    return;
  }
  const bool trusted = time_line_.verdict() == TimeLine::kAgrees;
  const auto saved = trusted ? shift_->PoseToSave() : std::nullopt;
  if (!saved) {
    options_.warn("the pose is not trusted and was not saved");
  } else if (const Status status = WriteSavedPose(*saved, File(kSavedPose)); !status.ok()) {
    options_.warn(Message(status) + ", the pose was not saved");
  }
}

// Only after WriteReport() is nothing lost without the journal. If this is never reached, the shift
// is taken up again and reports under the same UUID.
void Service::EndShift() {
  options_.inform(fmt::format("shift {} ends, report '{}'", last_uuid_, last_report_));
  if (const auto pose = shift_->Pose()) last_pose_ = pose->pose.T_map_vehicle;
  WriteJournal();
  journal_.reset();
  CheckLogs(logs_.Take(File(kJournal), last_uuid_));
  shift_.reset();
  held_until_.reset();
  given_start_.reset();
  time_line_ = TimeLineWatch(FromSeconds(kMaxRefusedS));
}

void Service::Refused(TimeLine why, std::vector<Event>* events) {
  const TimeLine before = time_line_.verdict();
  time_line_.Refused(why, options_.steady_clock());
  if (before != TimeLine::kAgrees || time_line_.verdict() == before) return;
  events->emplace_back(StateEvent{shift_->now(), LocalizerState::kLost});
  options_.warn(fmt::format("no item of the last {} s fits: {}",
                            kMaxRefusedS,
                            time_line_.verdict() == TimeLine::kLate
                                ? "all are late, the vehicle's clock was set back"
                                : "they are ahead of this host's clock, or ahead and late"));
}

void Service::Accepted(std::vector<Event>* events) {
  const bool told = time_line_.verdict() != TimeLine::kAgrees;
  time_line_.Accepted(options_.steady_clock());
  if (!told) return;
  events->emplace_back(StateEvent{shift_->now(), shift_->localizer().state()});
  options_.warn("items fit the time line again");
}

Status Service::BeginNextShift(std::optional<LoadedMap> map,
                               const std::optional<PoseWithCovariance>& start) {
  const std::string vehicle = shift_->header().vehicle;
  SHIFTMAP_RETURN_IF_ERROR(WriteReport());
  EndShift();
  if (map) TakeUp(*std::move(map));
  given_start_ = start;
  const Status status = BeginShift(NewHeader(vehicle));
  given_start_.reset();
  start_chosen_ = true;
  return status;
}

// A report's stamps ascend, and its journal gives the same bits again: both hold for each shift by
// itself. A localizer whose time goes back could keep neither.
bool Service::BeginAnotherTimeLine(Stamp begin, std::vector<Event>* events) {
  const auto now = options_.steady_clock();
  if (now < next_time_line_) return false;
  next_time_line_ = now + kRetryAfter;
  const Status status =
      BeginNextShift(std::nullopt, shift_->PoseAfter(ToSeconds(time_line_.SinceAccepted(now))));
  clock_jumps_ += status.ok();
  if (!status.ok()) {
    options_.warn(Message(status));
    return false;
  }
  events->emplace_back(StateEvent{begin, LocalizerState::kInitializing});
  return true;
}

}  // namespace shiftmap::live
