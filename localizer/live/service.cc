// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/service.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <utility>

#include "localizer/live/codec/journal_codec.h"
#include "mapstore/codec/shift_report.h"
#include "mapstore/map_store.h"
#include "proto/core/check.h"

namespace shiftmap::live {
namespace {

constexpr const char* kJournal = "shift.journal";
constexpr const char* kSavedPose = "pose";

Status MakeStateFolder(const std::string& path) {
  constexpr mode_t kAccess = 0750;
  if (mkdir(path.c_str(), kAccess) == 0 || errno == EEXIST) return OkStatus();
  return Unavailable("state folder '{}': cannot make it: {}", path, std::strerror(errno));
}

// Held as long as the descriptor is open, so that it ends with the process.
StatusOr<OwnedFd> Lock(const std::string& folder) {
  constexpr mode_t kFileAccess = 0640;
  OwnedFd fd(open((folder + "/lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, kFileAccess));
  if (fd.get() < 0) {
    return Unavailable("state folder '{}': cannot write: {}", folder, std::strerror(errno));
  }
  if (flock(fd.get(), LOCK_EX | LOCK_NB) != 0) {
    return Unavailable("state folder '{}': in use by another process", folder);
  }
  return fd;
}

Status CheckHash(const MapSnapshot& map, const std::string& expected) {
  if (expected.empty() || map.content_hash() == expected) return OkStatus();
  return FailedPrecondition("area '{}' version {}: content hash {}, expected {}",
                            map.area(),
                            map.version().value(),
                            map.content_hash(),
                            expected);
}

Status NoShift() { return FailedPrecondition("no shift is under way, expected a start first"); }

}  // namespace

StatusOr<MapSnapshot> LoadLiveMap(const std::string& path,
                                  const std::string& area,
                                  std::optional<VersionNumber> version,
                                  std::optional<Stamp> at) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, MapStore::Open(path, MapStore::Access::kReadOnly));
  return store.LoadAt(area, version, at);
}

StatusOr<Service> Service::Open(ServiceOptions options) {
  SHIFTMAP_CHECK(!options.vehicle.empty(), "a vehicle has a name");
  Service service(std::move(options));
  const ServiceOptions& set = service.options_;
  SHIFTMAP_RETURN_IF_ERROR(set.localizer.Validate());
  SHIFTMAP_RETURN_IF_ERROR(MakeStateFolder(set.state_dir));
  SHIFTMAP_ASSIGN_OR_RETURN(service.lock_, Lock(set.state_dir));
  SHIFTMAP_ASSIGN_OR_RETURN(service.map_, LoadLiveMap(set.map_path, set.area));
  SHIFTMAP_RETURN_IF_ERROR(CheckHash(*service.map_, set.content_hash));
  service.given_start_ = set.localizer.initial_pose;
  if (access(service.File(kJournal).c_str(), F_OK) == 0) {
    if (const Status status = service.Resume(); !status.ok()) service.SetJournalAside(status);
  }
  return service;
}

Reply Service::Handle(const Request& request, std::vector<Event>* events) {
  Reply reply;
  reply.id = request.id;
  reply.status =
      std::visit([&](const auto& command) { return Do(command, events); }, request.command);
  const bool fed = std::holds_alternative<OdometrySample>(request.command) ||
                   std::holds_alternative<Scan>(request.command);
  if (request.id != 0 && !fed) reply.state = State();
  const auto* get = std::get_if<GetState>(&request.command);
  if (get != nullptr && get->hypotheses) reply.hypotheses = Hypotheses();
  return reply;
}

std::optional<HypothesisView> Service::Hypotheses() const {
  const HypothesisBank* bank = shift_ ? shift_->localizer().hypotheses() : nullptr;
  if (bank == nullptr) return std::nullopt;
  return ViewHypotheses(*bank, shift_->localizer().snapshot());
}

Status Service::Do(const OdometrySample& sample, std::vector<Event>* events) {
  return Feed(sample, events);
}

Status Service::Do(const Scan& scan, std::vector<Event>* events) { return Feed(scan, events); }

Status Service::Feed(const RunEvent& item, std::vector<Event>* events) {
  if (!shift_) {
    dropped_.Add("no_shift");
    return NoShift();
  }
  const Stamp stamp = StampOf(item);
  if (const Stamp now = options_.clock(); stamp > now + FromSeconds(options_.max_future_s)) {
    dropped_.Add("future");
    return InvalidArgument("item at {:.6f} s, expected at most {:.3f} s after {:.6f} s, now",
                           ToSecondsSinceEpoch(stamp),
                           options_.max_future_s,
                           ToSecondsSinceEpoch(now));
  }
  if (!start_chosen_) ChooseStart(stamp);
  const std::int64_t late = shift_->localizer().Statistics().late;
  const auto begin = std::chrono::steady_clock::now();
  const Status status = shift_->Process(item, events);
  CountOverrun(begin);
  if (!status.ok()) {
    // What is too late is counted by the localizer.
    if (shift_->localizer().Statistics().late == late) dropped_.Add("invalid");
    return status;
  }
  journal_->Append(std::visit(
      [](const auto& value) { return EncodeJournalRecord(JournalRecord(value)); }, item));
  HoldUntilNextItem();
  return OkStatus();
}

void Service::CountOverrun(std::chrono::steady_clock::time_point begin) {
  const std::chrono::duration<double, std::milli> elapsed =
      std::chrono::steady_clock::now() - begin;
  if (elapsed.count() > options_.step_budget_ms) ++overruns_;
}

void Service::HoldUntilNextItem() {
  const double max_delay_s = shift_->header().max_delay_s;
  if (max_delay_s > 0.0) held_until_ = std::chrono::steady_clock::now() + FromSeconds(max_delay_s);
}

// The journal has no word of it: items in the order of their stamps give the same bits, whenever
// they were localized, and what came too late afterwards is not in it.
void Service::LocalizeHeld(std::chrono::steady_clock::time_point now, std::vector<Event>* events) {
  if (!held_until_ || now < *held_until_) return;
  held_until_.reset();
  if (!shift_) return;
  const auto begin = std::chrono::steady_clock::now();
  shift_->LocalizeHeld(events);
  CountOverrun(begin);
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
      UsableStart(*saved, *map_, now, shift_->header().odometer_m, options_.saved_pose);
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

Status Service::Do(const Start& start, std::vector<Event>*) {
  if (shift_) {
    return FailedPrecondition("shift {} is under way, expected a stop first",
                              shift_->header().uuid);
  }
  ShiftHeader header;
  header.uuid = RandomUuid();
  header.vehicle = start.vehicle.empty() ? options_.vehicle : start.vehicle;
  header.area = map_->area();
  header.version = map_->version();
  header.content_hash = map_->content_hash();
  header.map_stamp = map_->stamp();
  header.alpha = options_.localizer.hypotheses.alpha;
  header.max_leaves = options_.localizer.hypotheses.max_leaves;
  header.max_delay_s = options_.localizer.max_delay_s;
  header.odometer_m = start.odometer_m;
  SHIFTMAP_ASSIGN_OR_RETURN(journal_, JournalFile::Create(File(kJournal)));
  journal_->Append(EncodeJournalRecord(header));
  shift_.emplace(*map_, header);
  start_chosen_ = false;
  resumed_ = false;
  dropped_ = DropCounts();
  overruns_ = 0;
  last_uuid_ = header.uuid;
  if (given_start_) InitializeShift(*given_start_);
  CheckJournal(journal_->Sync());
  return OkStatus();
}

Status Service::Do(const InitializePose& start, std::vector<Event>*) {
  given_start_ = start.pose;
  if (shift_) InitializeShift(start.pose);
  return OkStatus();
}

Status Service::Do(const SetMap& map, std::vector<Event>*) {
  if (shift_) return FailedPrecondition("a map is set between shifts, expected a stop first");
  SHIFTMAP_ASSIGN_OR_RETURN(MapSnapshot loaded,
                            LoadLiveMap(options_.map_path, map.area, map.version));
  SHIFTMAP_RETURN_IF_ERROR(CheckHash(loaded, map.content_hash));
  map_ = std::move(loaded);
  return OkStatus();
}

Status Service::Do(const Stop& stop, std::vector<Event>*) {
  if (!shift_) return NoShift();
  ShiftReport report = shift_->Report(dropped_);
  report.software = options_.software;
  const std::string path = File(report.uuid + ".report");
  SHIFTMAP_RETURN_IF_ERROR(WriteShiftReport(report, path));
  last_report_ = path;
  if (stop.save_pose) {
    if (const auto saved = shift_->PoseToSave()) {
      SHIFTMAP_RETURN_IF_ERROR(WriteSavedPose(*saved, File(kSavedPose)));
    } else {
      options_.warn("the pose is not trusted and was not saved");
    }
  }
  // Only now is nothing lost without it. If this is never reached, the shift is taken up again and
  // reports under the same UUID.
  journal_.reset();
  unlink(File(kJournal).c_str());
  shift_.reset();
  held_until_.reset();
  given_start_.reset();
  return OkStatus();
}

Status Service::Shutdown() {
  if (!shift_) return OkStatus();
  std::vector<Event> ignored;
  return Do(Stop{.save_pose = true}, &ignored);
}

void Service::CheckJournal(const Status& status) {
  if (status.ok()) return;
  dropped_.Add("journal_error");
  if (!std::exchange(journal_warned_, true)) options_.warn(Message(status));
}

void Service::WriteJournal() {
  if (journal_) CheckJournal(journal_->Write());
}

void Service::SyncJournal() {
  if (journal_) CheckJournal(journal_->StartSync());
}

ServiceState Service::State() const {
  ServiceState state;
  state.running = shift_.has_value();
  state.area = map_->area();
  state.version = map_->version();
  state.content_hash = map_->content_hash();
  state.report_uuid = last_uuid_;
  state.report_path = last_report_;
  state.resumed = resumed_;
  state.overruns = overruns_;
  DropCounts dropped = dropped_;
  if (shift_) {
    const LocalizerStatistics statistics = shift_->localizer().Statistics();
    AddDropped(statistics, &dropped);
    state.localizer_state = shift_->localizer().state();
    state.calibrated_vehicle = shift_->localizer().snapshot().calibrated_vehicle();
    state.stamp = shift_->now();
    if (const auto pose = shift_->Pose()) state.pose = pose->pose;
    state.scans = statistics.scans;
    state.decisions = static_cast<std::int64_t>(shift_->localizer().decisions().size());
  }
  state.dropped = dropped.List();
  return state;
}

}  // namespace shiftmap::live
