// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "localizer/live/drop_counts.h"
#include "localizer/live/fleet_actions.h"
#include "localizer/live/journal_file.h"
#include "localizer/live/messages.h"
#include "localizer/live/resume_mark.h"
#include "localizer/live/shift.h"
#include "localizer/live/shift_logs.h"
#include "localizer/live/time_line_watch.h"
#include "localizer/localizer_options.h"
#include "mapstore/core/owned_fd.h"
#include "mapstore/map/map_snapshot.h"
#include "proto/core/status.h"

namespace shiftmap::live {

struct ServiceOptions {
  std::string map_path;  ///< Map store or snapshot.
  std::string area;

  /// If not empty, the map is the enabled one of the area in this folder, which actions change, and
  /// `map_path` is of no meaning.
  std::string map_folder;

  /// Only a client that subscribed as the maps' owner may change them.
  bool has_map_owner = false;

  /// Begins a shift as soon as there is a map, if none is under way.
  bool start = false;

  std::string content_hash;  ///< If not empty, what the map's must be.
  std::string state_dir;  ///< Folder for journal, saved pose and reports; made if it is not there.
  std::string vehicle;    ///< Name in the fleet, if a start gives none.
  std::string software;   ///< As ShiftReport::software.
  LocalizerOptions localizer;  ///< Valid; `initial_pose` is that of the first start.

  /// Older saved poses are not used, >= 0. [s]
  double max_pose_age_s = 900.0;

  /// What the run logs of all shifts may take in the state folder; 0: none are kept. [byte]
  std::int64_t max_log_bytes = std::int64_t{4} << 30;

  /// Recordings of the shifts, in another folder than `state_dir`.
  ShiftRecordings recordings;

  /// A step that takes longer counts as an overrun, > 0. [ms]
  double step_budget_ms = 20.0;

  /// The host's clock.
  std::function<Stamp()> clock;

  /// A clock that nobody sets, of the items' arrival.
  std::function<std::chrono::steady_clock::time_point()> steady_clock =
      std::chrono::steady_clock::now;

  /// Called with one line for a fault that does not end the service, and for an event of a shift.
  std::function<void(const std::string&)> warn;
  std::function<void(const std::string&)> inform = [](const std::string&) {};

  /// Called often while a shift is resumed.
  std::function<void()> resuming;
};

/// What stands behind the socket: one map, at most one shift, and the files that let a shift
/// survive a crash. Knows nothing of connections. With a folder of maps, there may be no map yet:
/// then no shift begins.
///
/// One process per state folder: it is locked. A step computes only; WriteJournal() and
/// SyncJournal() are called between steps. Files in the state folder: `shift.journal` while a shift
/// is under way, `shift.resuming` while one is taken up, `pose`, `actions` (ActionLog), and of each
/// shift that has ended `<uuid>.report` and its run log (ShiftLogs).
class Service {
 public:
  /// Loads the map and takes up a shift that was interrupted. A journal that does not fit the map
  /// any more is kept under another name. So is one that ended the process twice at one place while
  /// it was taken up: the vehicle drives on, so another shift begins at once, without a pose.
  /// Errors: as MapStore::LoadAt; kInvalidArgument for options that no report or path can carry;
  /// kFailedPrecondition for another content hash; kUnavailable if the state folder cannot be used,
  /// or another process uses it.
  static StatusOr<Service> Open(ServiceOptions options);

  /// Does what a request asks for; what subscribers may want to know is appended to `events`.
  /// Subscribe is the connection's business and does nothing here.
  Reply Handle(const Request& request, std::vector<Event>* events);

  /// Localizes what waits for late items once the last item is older than the bound on the delay:
  /// a stream that pauses must not keep it waiting. Events are appended to `events`.
  /// @param now  By the clock of the items' arrival, std::chrono::steady_clock.
  void LocalizeHeld(std::chrono::steady_clock::time_point now, std::vector<Event>* events);

  /// When LocalizeHeld() has something to do if no item comes; nothing if nothing waits.
  std::optional<std::chrono::steady_clock::time_point> held_until() const { return held_until_; }

  /// Does what waits for the vehicle to stand, or for landmarks to agree with a pose.
  void StepCallback(std::vector<Event>* events);

  /// As FleetActions::SetDownloader().
  void SetDownloader(bool present) { fleet_.SetDownloader(present); }

  /// Counts what a connection dropped.
  void CountDropped(const std::string& reason, std::int64_t count = 1) {
    dropped_.Add(reason, count);
  }

  /// Hands the steps since the last call to the operating system, or has a thread make them
  /// durable; neither waits for the disk. A disk that does not take them does not stop the vehicle:
  /// it is counted and warned of.
  void WriteJournal();
  void SyncJournal();

  /// Ends the shift, if one is under way, saving its pose. Errors: kUnavailable if the disk does
  /// not take the report; the journal then keeps the shift.
  Status Shutdown();

  ServiceState State() const;

  /// Maps are changed by the client that owns them.
  bool has_map_owner() const { return options_.has_map_owner; }

 private:
  static constexpr const char* kJournal = "shift.journal";
  static constexpr const char* kResumeMark = "shift.resuming";

  // For how long all items must be refused for their stamps until a clock counts as set. [s]
  static constexpr double kMaxRefusedS = 1.0;

  // A map with what keeps its file.
  struct LoadedMap {
    MapSnapshot map;
    std::optional<FolderMap> file{};  // Of the folder, if there is one.
    std::optional<MapUse> use{};
  };

  // A pose that landmarks have to agree with.
  struct PoseCheck {
    std::string action_id;
    Stamp begin;
    std::int64_t scans = 0;  // Localized before it.
  };

  std::optional<HypothesisView> Hypotheses() const;

  Service(ServiceOptions options, FleetActions fleet)
      : options_(std::move(options)),
        logs_(options_.state_dir, options_.max_log_bytes, options_.recordings),
        time_line_(FromSeconds(kMaxRefusedS)),
        fleet_(std::move(fleet)),
        area_(options_.area) {}

  Status Do(const OdometrySample& sample, std::vector<Event>* events);
  Status Do(const Scan& scan, std::vector<Event>* events);
  Status Do(const LidarScan& scan, std::vector<Event>* events);
  Status Do(const GetState&, std::vector<Event>*) { return OkStatus(); }
  Status Do(const Subscribe&, std::vector<Event>*) { return OkStatus(); }
  Status Do(const Start& start, std::vector<Event>* events);
  Status Do(const Stop& stop, std::vector<Event>* events);
  Status Do(const SetMap& map, std::vector<Event>* events);
  Status Do(const InitializePose& start, std::vector<Event>* events);

  // Actions of the fleet's control.
  Status Do(const DownloadMap& action, std::vector<Event>* events) {
    return fleet_.Do(action, events);
  }
  Status Do(const EnableMap& action, std::vector<Event>* events);
  Status Do(const DeleteMap& action, std::vector<Event>*) { return fleet_.Do(action); }
  Status Do(const InitializePosition& action, std::vector<Event>* events);
  Status Do(const ClearActions&, std::vector<Event>*);
  Status Do(const GetFleetState&, std::vector<Event>*) { return OkStatus(); }
  Status Do(const MapDownloadProgress& progress, std::vector<Event>* events) {
    return fleet_.Do(progress, events);
  }
  Status CheckOwner(const Request& request);
  bool MustWait(const FolderMap& file) const;
  bool Stands() const;
  Status Enable(const FolderMap& file, std::vector<Event>* events);
  Status Position(const InitializePosition& action, std::vector<Event>* events);
  void CheckPose();
  FleetState Fleet() const;

  // The map of the folder that is enabled, and its place in this service.
  StatusOr<LoadedMap> Loaded(const FolderMap& file);
  Status TakeUpEnabledMap();
  void TakeUp(LoadedMap map);

  // The map that a shift was begun on.
  bool IsMapOf(const ShiftHeader& header) const;
  StatusOr<LoadedMap> LoadedOf(const ShiftHeader& header);

  Status Feed(const RunEvent& item, std::vector<Event>* events);
  Status Step(const RunEvent& item, bool* late, std::vector<Event>* events);
  void HoldUntilNextItem();
  void WarnOfImplausible();  // Once per shift.
  void CountOverrun(std::chrono::steady_clock::time_point begin);
  void Inform(const std::vector<Event>& events, std::size_t first) const;

  // An item was refused or taken for its stamp; a change of the verdict is an event.
  void Refused(TimeLine why, std::vector<Event>* events);
  void Accepted(std::vector<Event>* events);

  // Goes on with another shift, whose stamps begin anew. False if the disk does not take the
  // report.
  bool BeginAnotherTimeLine(Stamp begin, std::vector<Event>* events);

  // A shift from its first record to its report.
  ShiftHeader NewHeader(const std::string& vehicle) const;
  Status BeginShift(const ShiftHeader& header);

  // Ends the shift with its report; another one begins at a pose, or finds it. Nothing has changed
  // if the disk does not take the report.
  // @param map  Nothing: the same.
  Status BeginNextShift(std::optional<LoadedMap> map,
                        const std::optional<PoseWithCovariance>& start);
  Status WriteReport();
  void SavePose();
  void EndShift();

  // Where a shift starts: a pose that somebody gave, or the saved one, or it will be found.
  void ChooseStart(Stamp now);
  void InitializeShift(const PoseWithCovariance& pose);

  void TakeUpJournal();
  Status Resume(const ResumeMark& mark);
  void BeginInsteadOf(const ResumeMark& mark);
  void SetJournalAside(const Status& why);
  void CheckJournal(const Status& status);
  void CheckLogs(const Status& status);
  std::string File(const std::string& name) const { return options_.state_dir + "/" + name; }

  ServiceOptions options_;
  OwnedFd lock_;
  std::optional<LoadedMap> map_;
  std::optional<Shift> shift_;
  std::optional<JournalFile> journal_;
  ShiftLogs logs_;
  std::optional<PoseWithCovariance> given_start_;  // For the shift that starts next.
  std::optional<std::chrono::steady_clock::time_point> held_until_;
  TimeLineWatch time_line_;
  std::chrono::steady_clock::time_point next_time_line_;  // When another may begin.
  std::int64_t clock_jumps_ = 0;
  bool start_chosen_ = false;
  bool resumed_ = false;
  std::set<std::string> journal_warnings_;  // Of this shift, each once.
  bool implausible_warned_ = false;
  DropCounts dropped_;
  std::int64_t overruns_ = 0;
  std::string last_uuid_;
  std::string last_report_;
  FleetActions fleet_;
  std::string area_;
  std::optional<EnableMap> waiting_;  // For the vehicle to stand.
  std::optional<PoseCheck> pose_check_;
  std::optional<Se2> last_pose_;  // Of the last shift.
};

/// The map that a shift was begun on, from the file or the folder of maps of a service's options.
/// Errors: kNotFound if it is not there any more.
StatusOr<MapSnapshot> LoadMapOfShift(const ServiceOptions& options, const ShiftHeader& header);

/// The version of an area with the probabilities of a time; nothing: the published one, now.
StatusOr<MapSnapshot> LoadLiveMap(const std::string& path,
                                  const std::string& area,
                                  std::optional<VersionNumber> version = std::nullopt,
                                  std::optional<Stamp> at = std::nullopt);

}  // namespace shiftmap::live
