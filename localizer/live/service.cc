// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/service.h"

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <climits>
#include <cstring>
#include <utility>

#include "localizer/live/codec/journal_codec.h"
#include "mapstore/core/lock_file.h"
#include "mapstore/map/shift_report_check.h"
#include "mapstore/map_store.h"

namespace shiftmap::live {
namespace {

constexpr std::size_t kLongestFileName = 128;  // In the state folder.
constexpr double kMaxFutureS = 1.0;            // A stamp may be as far ahead of this host's clock.

Status MakeFolder(const char* folder, const std::string& path) {
  constexpr mode_t kAccess = 0750;
  constexpr std::size_t kLongestPath = PATH_MAX - kLongestFileName;
  if (path.size() > kLongestPath) {
    return InvalidArgument(
        "{} folder: path of {} bytes, expected at most {}", folder, path.size(), kLongestPath);
  }
  if (mkdir(path.c_str(), kAccess) == 0 || errno == EEXIST) return OkStatus();
  const int error = errno;
  return MakeStatus(PathErrorCode(error),
                    "{} folder '{}': cannot make it: {}",
                    folder,
                    path,
                    std::strerror(error));
}

// Held as long as the descriptor is open, so that it ends with the process.
StatusOr<OwnedFd> Lock(const std::string& folder) {
  StatusOr<std::optional<OwnedFd>> lock = LockFile(folder + "/lock");
  SHIFTMAP_RETURN_IF_ERROR(Annotate(lock.status(), "state folder '{}'", folder));
  if (*lock) return **std::move(lock);
  return Unavailable("state folder '{}': in use by another process", folder);
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
  SHIFTMAP_RETURN_IF_ERROR(CheckReportText("vehicle", options.vehicle));
  SHIFTMAP_RETURN_IF_ERROR(options.localizer.Validate());
  SHIFTMAP_RETURN_IF_ERROR(MakeFolder("state", options.state_dir));
  if (!options.recordings.folder.empty()) {
    SHIFTMAP_RETURN_IF_ERROR(MakeFolder("recording", options.recordings.folder));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(OwnedFd lock, Lock(options.state_dir));
  ActionLog log(options.state_dir + "/actions");
  if (const Status status = log.Read(); !status.ok()) options.warn(Message(status));
  std::optional<MapFolder> folder;
  if (!options.map_folder.empty()) {
    SHIFTMAP_ASSIGN_OR_RETURN(folder, MapFolder::Open(options.map_folder));
  }
  Service service(std::move(options), FleetActions(std::move(log), std::move(folder)));
  const ServiceOptions& set = service.options_;
  service.lock_ = std::move(lock);
  if (service.fleet_.has_folder()) {
    // Without a map it can still be told to get one.
    const Status status = service.TakeUpEnabledMap();
    if (!status.ok()) set.warn(Message(status));
  } else {
    SHIFTMAP_ASSIGN_OR_RETURN(MapSnapshot map, LoadLiveMap(set.map_path, set.area));
    SHIFTMAP_RETURN_IF_ERROR(CheckHash(map, set.content_hash));
    service.TakeUp({std::move(map)});
  }
  service.given_start_ = set.localizer.initial_pose;
  service.TakeUpJournal();
  return service;
}

Reply Service::Handle(const Request& request, std::vector<Event>* events) {
  Reply reply;
  reply.id = request.id;
  const std::size_t first = events->size();
  reply.status = CheckOwner(request);
  if (reply.status.ok()) {
    reply.status =
        std::visit([&](const auto& command) { return Do(command, events); }, request.command);
  }
  Inform(*events, first);
  // Nobody gets what no id asks for.
  if (request.id == 0) return reply;
  if (AsksForFleetState(request.command)) {
    reply.fleet_state = Fleet();
  } else if (!Feeds(request.command)) {
    reply.state = State();
  }
  const auto* get = std::get_if<GetState>(&request.command);
  if (get != nullptr && get->hypotheses) reply.hypotheses = Hypotheses();
  return reply;
}

void Service::Inform(const std::vector<Event>& events, std::size_t first) const {
  for (std::size_t i = first; i < events.size(); ++i) {
    if (const auto* state = std::get_if<StateEvent>(&events[i])) {
      options_.inform(fmt::format(
          "{} from {:.3f} s on", ToString(state->state), ToSecondsSinceEpoch(state->stamp)));
    } else if (const auto* decision = std::get_if<Decision>(&events[i])) {
      options_.inform(fmt::format("landmark '{}' is at mode {}, log-odds {:.1f}, at {:.3f} s",
                                  decision->signature.text(),
                                  decision->mode.value(),
                                  decision->log_odds,
                                  ToSecondsSinceEpoch(decision->stamp)));
    }
  }
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

Status Service::Do(const LidarScan& scan, std::vector<Event>* events) { return Feed(scan, events); }

Status Service::Feed(const RunEvent& item, std::vector<Event>* events) {
  if (!shift_) {
    dropped_.Add("no_shift");
    return NoShift();
  }
  const Stamp stamp = StampOf(item);
  if (const Stamp now = options_.clock(); stamp > now + FromSeconds(kMaxFutureS)) {
    dropped_.Add("future");
    Refused(TimeLine::kFuture, events);
    return InvalidArgument("item at {:.6f} s, expected at most {:.3f} s after {:.6f} s, now",
                           ToSecondsSinceEpoch(stamp),
                           kMaxFutureS,
                           ToSecondsSinceEpoch(now));
  }
  bool late = false;
  Status status = Step(item, &late, events);
  if (late) {
    Refused(TimeLine::kLate, events);
    if (time_line_.verdict() != TimeLine::kLate || !BeginAnotherTimeLine(stamp, events))
      return status;
    status = Step(item, &late, events);
  }
  if (status.ok()) Accepted(events);
  return status;
}

Status Service::Step(const RunEvent& item, bool* late, std::vector<Event>* events) {
  if (!start_chosen_) ChooseStart(StampOf(item));
  const std::int64_t late_before = shift_->localizer().Statistics().late;
  const auto begin = std::chrono::steady_clock::now();
  const Status status = shift_->Process(item, events);
  CountOverrun(begin);
  if (!status.ok()) {
    // What is too late is counted by the localizer.
    *late = shift_->localizer().Statistics().late > late_before;
    if (!*late) dropped_.Add("invalid");
    return status;
  }
  journal_->Append(std::visit(
      [](const auto& value) { return EncodeJournalRecord(JournalRecord(value)); }, item));
  WarnOfImplausible();
  HoldUntilNextItem();
  return OkStatus();
}

void Service::WarnOfImplausible() {
  const std::string& first = shift_->localizer().first_implausible();
  if (first.empty() || std::exchange(implausible_warned_, true)) return;
  options_.warn(first + ": no vehicle or sensor does that, dropped, as all like it");
}

void Service::CountOverrun(std::chrono::steady_clock::time_point begin) {
  const std::chrono::duration<double, std::milli> elapsed =
      std::chrono::steady_clock::now() - begin;
  if (elapsed.count() > options_.step_budget_ms) ++overruns_;
}

void Service::HoldUntilNextItem() {
  const double max_delay_s = shift_->header().max_delay_s;
  if (max_delay_s > 0.0) held_until_ = options_.steady_clock() + FromSeconds(max_delay_s);
}

// The journal has no word of it: items in the order of their stamps give the same bits, whenever
// they were localized, and what came too late afterwards is not in it.
void Service::LocalizeHeld(std::chrono::steady_clock::time_point now, std::vector<Event>* events) {
  if (!held_until_ || now < *held_until_) return;
  held_until_.reset();
  if (!shift_) return;
  const std::size_t first = events->size();
  const auto begin = std::chrono::steady_clock::now();
  shift_->LocalizeHeld(events);
  CountOverrun(begin);
  Inform(*events, first);
}

Status Service::Do(const InitializePose& start, std::vector<Event>*) {
  given_start_ = start.pose;
  if (shift_) InitializeShift(start.pose);
  return OkStatus();
}

Status Service::Do(const SetMap& map, std::vector<Event>*) {
  if (shift_) return FailedPrecondition("a map is set between shifts, expected a stop first");
  if (fleet_.has_folder()) {
    return FailedPrecondition("maps of a folder are enabled, expected enable-map");
  }
  SHIFTMAP_ASSIGN_OR_RETURN(MapSnapshot loaded,
                            LoadLiveMap(options_.map_path, map.area, map.version));
  SHIFTMAP_RETURN_IF_ERROR(CheckHash(loaded, map.content_hash));
  TakeUp({std::move(loaded)});
  return OkStatus();
}

Status Service::Do(const Stop& stop, std::vector<Event>*) {
  if (!shift_) return NoShift();
  SHIFTMAP_RETURN_IF_ERROR(WriteReport());
  if (stop.save_pose) SavePose();
  EndShift();
  return OkStatus();
}

Status Service::Shutdown() {
  Status status = OkStatus();
  if (shift_) {
    std::vector<Event> ignored;
    status = Do(Stop{.save_pose = true}, &ignored);
  }
  CheckLogs(logs_.Finish());
  if (const Status kept = fleet_.log().Finish(); !kept.ok()) options_.warn(Message(kept));
  return status;
}

// A missing log loses no evidence: the report holds it.
void Service::CheckLogs(const Status& status) {
  if (status.ok()) return;
  options_.warn(Message(status));
}

void Service::CheckJournal(const Status& status) {
  if (status.ok()) return;
  dropped_.Add("journal_error");
  if (journal_warnings_.insert(Message(status)).second) options_.warn(Message(status));
}

void Service::WriteJournal() {
  if (journal_) CheckJournal(journal_->Write());
}

void Service::SyncJournal() {
  if (journal_) CheckJournal(journal_->StartSync());
  CheckLogs(logs_.StepCallback());
  if (const Status status = fleet_.log().StartWrite(); !status.ok()) options_.warn(Message(status));
}

ServiceState Service::State() const {
  ServiceState state;
  state.running = shift_.has_value();
  state.area = area_;
  if (map_) {
    state.version = map_->map.version();
    state.content_hash = map_->map.content_hash();
  }
  state.report_uuid = last_uuid_;
  state.report_path = last_report_;
  state.resumed = resumed_;
  state.overruns = overruns_;
  state.clock_jumps = clock_jumps_;
  state.time_line = time_line_.verdict();
  DropCounts dropped = dropped_;
  if (shift_) {
    const LocalizerStatistics statistics = shift_->localizer().Statistics();
    AddDropped(statistics, &dropped);
    state.localizer_state = shift_->localizer().state();
    state.calibrated_vehicle = shift_->localizer().snapshot().calibrated_vehicle();
    state.stamp = shift_->now();
    if (const auto pose = shift_->Pose()) state.pose = pose->pose;
    if (state.time_line != TimeLine::kAgrees) {
      state.localizer_state = LocalizerState::kLost;
      state.pose.reset();
    }
    state.scans = statistics.scans;
    state.decisions = static_cast<std::int64_t>(shift_->localizer().decisions().size());
  }
  state.dropped = dropped.List();
  return state;
}

}  // namespace shiftmap::live
