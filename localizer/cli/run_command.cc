// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "localizer/cli/commands.h"
#include "localizer/cli/localizer_arguments.h"
#include "localizer/cli/return_to_store.h"
#include "localizer/cli/run_json.h"
#include "localizer/live/drop_counts.h"
#include "localizer/localizer.h"
#include "localizer/recording/shift_recorder.h"
#include "mapstore/cli/input_options.h"
#include "mapstore/cli/stop_signals.h"
#include "mapstore/cli/store_access.h"
#include "mapstore/cli/version.h"
#include "mapstore/codec/run_log.h"
#include "mapstore/codec/shift_report.h"
#include "mapstore/core/count_text.h"
#include "mapstore/map/shift_report_check.h"
#include "mapstore/map_store.h"
#include "mapstore/run/trajectory.h"

namespace shiftmap {
namespace {

// Signatures that are counted at most: a log of noise has no end of them.
constexpr std::size_t kMaxSignatures = 100'000;

struct RunOptions {
  std::optional<std::string> store;
  std::optional<std::string> snapshot;
  std::string area;
  std::optional<std::string> vehicle;
  std::optional<std::string> trajectory;
  std::optional<std::string> report;
  std::optional<std::string> recording;
  bool return_report = false;
  double clock_tolerance_s = kDefaultClockToleranceS;
  LocalizerArguments localizer;
  std::string run;
};

// What is wrong with the options as a whole; empty if nothing is.
std::string CheckOptions(const RunOptions& options) {
  if (options.store.has_value() == options.snapshot.has_value()) {
    return "give either --store or --snapshot";
  }
  if (options.return_report && !options.store) return "--return needs --store";
  if (std::string wrong = options.localizer.Check(); !wrong.empty()) return wrong;
  return options.vehicle ? Message(CheckReportText("--vehicle", *options.vehicle)) : "";
}

// The map at the begin of a log: what was learned after it, and of it, is not known to it yet.
StatusOr<MapSnapshot> LoadMap(const RunOptions& options,
                              Stamp begin,
                              MapStore* store,
                              const Context& context) {
  StatusOr<MapSnapshot> map = store->LoadAt(options.area, std::nullopt, begin);
  if (map.ok() || map.status().code() != StatusCode::kNotFound) return map;
  // A snapshot that was made after the log lacks the past.
  StatusOr<MapSnapshot> oldest = store->LoadAt(options.area);
  if (oldest.ok()) context.Warn(Message(map.status()));
  return oldest;
}

// A log of another area may be tried, but says nothing of this one's landmarks.
Status CheckArea(const RunOptions& options, const RunInfo& info, const Context& context) {
  if (info.area.empty() || info.area == options.area) return OkStatus();
  const std::string message =
      fmt::format("run log '{}': is of area '{}', not '{}'", options.run, info.area, options.area);
  if (options.return_report) return InvalidArgument("{}", message);
  context.Warn(message);
  return OkStatus();
}

std::string Software() { return "shiftmap-localizer " + SoftwareVersion(); }

// One shift: a localizer and what is recorded around it.
class Shift {
 public:
  // The map for a log that begins then.
  using MapAt = std::function<StatusOr<MapSnapshot>(const RunInfo& info, Stamp begin)>;

  // @param vehicle    Nothing: as the log names it.
  // @param recording  File to record to; nothing: none.
  Shift(MapAt map_at,
        std::optional<std::string> vehicle,
        std::optional<std::string> recording,
        const LocalizerOptions& options)
      : map_at_(std::move(map_at)),
        vehicle_(std::move(vehicle)),
        recording_(std::move(recording)),
        options_(options) {}

  // A file is read whole, because the report names its hash.
  Status ProcessFile(const std::string& path) {
    SHIFTMAP_ASSIGN_OR_RETURN(const RunLog log, ReadRunLog(path, {.lidar_scans = UsesLidar()}));
    const auto take = [&](const RunEvent& event) -> Status {
      if (!StopSignals::Received().empty()) return MakeStatus(StatusCode::kCancelled, "stopped");
      if (!localizer_) SHIFTMAP_RETURN_IF_ERROR(Begin(log.run.info, StampOf(event)));
      return Process(event);
    };
    SHIFTMAP_RETURN_IF_ERROR(ForEachEvent(log.run, take));
    run_hash_ = log.sha256;
    run_uuid_ = log.run.info.uuid;
    summary_.truncation = log.truncation;
    return OkStatus();
  }

  Status ProcessStream(const std::string& path) {
    SHIFTMAP_ASSIGN_OR_RETURN(RunLogStream stream, RunLogStream::Open(path, UsesLidar()));
    while (StopSignals::Received().empty()) {
      SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<RunEvent> event, stream.Next());
      if (!event) break;
      if (!localizer_) SHIFTMAP_RETURN_IF_ERROR(Begin(stream.info(), StampOf(*event)));
      SHIFTMAP_RETURN_IF_ERROR(Annotate(Process(*event), "run log '{}'", path));
    }
    if (!has_odometry_) return InvalidArgument("run log '{}': no odometry", path);
    run_uuid_ = stream.info().uuid;
    const std::string signal = StopSignals::Received();
    summary_.truncation = signal.empty() ? stream.truncation() : "stopped by " + signal;
    return OkStatus();
  }

  ShiftReport Finish() {
    localizer_->Flush();
    RecordPoses();
    if (const HypothesisBank* bank = localizer_->hypotheses()) {
      summary_.hypotheses = ViewHypotheses(*bank, localizer_->snapshot());
    }
    localizer_->Finish();
    ShiftReport report = localizer_->Report();
    report.uuid = RandomUuid();
    report.vehicle = log_vehicle_.empty() ? summary_.vehicle : log_vehicle_;
    report.run_hash = run_hash_;
    report.run_uuid = run_uuid_;
    report.software = Software();
    live::DropCounts dropped;
    live::AddDropped(localizer_->Statistics(), &dropped);
    report.dropped = dropped.List();
    LeaveOutInvalid(&report);
    summary_.report_uuid = report.uuid;
    return report;
  }

  // Places the recording, if there is one.
  Status FinishRecording() {
    SHIFTMAP_RETURN_IF_ERROR(recorded_);
    return recorder_ ? recorder_->Finish() : OkStatus();
  }

  const Localizer& localizer() const { return *localizer_; }
  const RunSummary& summary() const { return summary_; }
  const std::vector<StampedPose>& trajectory() const { return trajectory_; }

 private:
  bool UsesLidar() const {
    return options_.hypotheses.field_of_view.model == FieldOfViewModel::kScanPolygon;
  }

  // The calibration is that of the vehicle, which only the log names.
  Status Begin(const RunInfo& info, Stamp begin) {
    SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, map_at_(info, begin));
    log_vehicle_ = info.vehicle;
    summary_.vehicle = vehicle_.value_or(info.vehicle);
    localizer_.emplace(map.ForVehicle(summary_.vehicle), options_);
    if (!recording_) return OkStatus();
    RecordedShift shift;
    shift.vehicle = summary_.vehicle;
    shift.run_uuid = info.uuid;
    shift.software = Software();
    SHIFTMAP_ASSIGN_OR_RETURN(
        recorder_, ShiftRecorder::Create(*recording_, shift, localizer_->snapshot(), begin));
    return OkStatus();
  }

  Status Process(const RunEvent& event) {
    const std::int64_t late = localizer_->Statistics().late;
    const auto begin = std::chrono::steady_clock::now();
    if (const Status status = localizer_->Process(event); !status.ok()) {
      // Dropped and counted, if there is a bound to how late items are.
      const bool may_be_late = options_.max_delay_s > 0.0;
      if (may_be_late && localizer_->Statistics().late > late) return OkStatus();
      return status;
    }
    const std::chrono::duration<double, std::milli> elapsed =
        std::chrono::steady_clock::now() - begin;
    if (const auto* scan = std::get_if<Scan>(&event)) {
      summary_.latencies_ms.push_back(elapsed.count());
      CountSignatures(*scan);
    }
    has_odometry_ |= std::holds_alternative<OdometrySample>(event);
    RecordPoses();
    return OkStatus();
  }

  void CountSignatures(const Scan& scan) {
    for (const Observation& observation : scan.observations) {
      const Signature& signature = observation.signature;
      if (signature.anonymous() || summary_.signatures.size() >= kMaxSignatures ||
          !summary_.signatures.insert(signature).second) {
        continue;
      }
      if (localizer_->snapshot().GroupIndex(signature) >= 0) ++summary_.known_signatures;
    }
  }

  void RecordPoses() {
    for (const PoseEstimate& estimate : localizer_->new_estimates()) {
      trajectory_.push_back({estimate.stamp, estimate.pose.T_map_vehicle});
    }
    if (recorder_ && recorded_.ok()) recorded_ = recorder_->Record(*localizer_);
  }

  MapAt map_at_;
  std::optional<std::string> vehicle_;
  std::optional<std::string> recording_;
  LocalizerOptions options_;
  std::optional<Localizer> localizer_;     // From the first item on.
  std::optional<ShiftRecorder> recorder_;  // If there is something to record to.
  Status recorded_;
  RunSummary summary_;
  std::vector<StampedPose> trajectory_;
  bool has_odometry_ = false;
  std::string log_vehicle_;  // Whose run it is, which the report is about.
  std::string run_hash_;
  std::string run_uuid_;
};

// Areas of a store of which the log saw at least as many landmarks as of the one that it was
// localized in: areas may name their landmarks alike.
StatusOr<std::vector<std::string>> OtherAreas(const RunSummary& summary,
                                              const std::string& area,
                                              MapStore* store) {
  std::vector<std::string> better;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<AreaSummary> areas, store->Areas());
  for (const AreaSummary& other : areas) {
    if (other.area == area || !other.published) continue;
    SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map,
                              store->LoadVersion(other.area, *other.published));
    const auto known = static_cast<std::size_t>(
        std::count_if(summary.signatures.begin(), summary.signatures.end(), [&](const auto& seen) {
          return map.GroupIndex(seen) >= 0;
        }));
    if (known == 0 || known < summary.known_signatures) continue;
    better.push_back(fmt::format("'{}' has {}", other.area, known));
  }
  return better;
}

// A shift without a pose is a result: this map does not fit the log.
Status ReportNotLocalized(const RunOptions& options,
                          const RunSummary& summary,
                          MapStore* store,
                          Context* context) {
  if (summary.signatures.empty()) {
    context->Attend(fmt::format("run log '{}': not localized, it saw no landmark with a signature",
                                options.run),
                    ExitCode::kNotLocalized);
    return OkStatus();
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<std::string> better,
                            OtherAreas(summary, options.area, store));
  context->Attend(fmt::format("run log '{}': not localized, area '{}' has {} of the {} landmarks "
                              "that it saw{}{}",
                              options.run,
                              options.area,
                              summary.known_signatures,
                              summary.signatures.size(),
                              better.empty() ? "" : "; area ",
                              fmt::join(better, ", area ")),
                  ExitCode::kNotLocalized);
  return OkStatus();
}

StatusOr<std::optional<ReturnResult>> WriteResults(const RunOptions& options,
                                                   const ShiftReport& report,
                                                   const Context& context,
                                                   Shift* shift) {
  std::optional<MapStore> store;
  if (options.return_report && shift->localizer().Statistics().localized()) {
    SHIFTMAP_ASSIGN_OR_RETURN(
        store,
        OpenStore(
            *options.store, MapStore::Access::kReadWrite, context, options.clock_tolerance_s));
    // Fails before a file is written if the store would refuse the report.
    SHIFTMAP_RETURN_IF_ERROR(store->CheckClock(report));
    WarnOfUnsetClock(fmt::format("run log '{}'", options.run), report, context);
  }
  if (options.trajectory) {
    SHIFTMAP_RETURN_IF_ERROR(WriteTum(shift->trajectory(), *options.trajectory));
  }
  SHIFTMAP_RETURN_IF_ERROR(shift->FinishRecording());
  if (options.report) SHIFTMAP_RETURN_IF_ERROR(WriteShiftReport(report, *options.report));
  if (!store) return std::optional<ReturnResult>();
  SHIFTMAP_ASSIGN_OR_RETURN(const ReturnResult returned, store->Return(report));
  return std::optional(returned);
}

// Nothing of a localizer that dropped nothing.
void WarnOfImplausible(const std::string& run, const Localizer& localizer, const Context& context) {
  if (localizer.first_implausible().empty()) return;
  const LocalizerStatistics statistics = localizer.Statistics();
  context.Warn(fmt::format(
      "run log '{}': dropped {} odometry samples and {} observations that no vehicle or "
      "sensor has, the first: {}",
      run,
      statistics.implausible_odometry,
      statistics.implausible_observations,
      localizer.first_implausible()));
}

void WarnOfGaps(const std::string& run, const Localizer& localizer, const Context& context) {
  const LocalizerStatistics statistics = localizer.Statistics();
  if (statistics.gaps == 0) return;
  context.Warn(
      fmt::format("run log '{}': {} without odometry and scans, {:.1f} s in all, in which the pose "
                  "is lost and no state counts",
                  run,
                  CountText(statistics.gaps, "gap"),
                  statistics.gap_s));
}

// Without a lidar scan the sector model is used, although the polygon was configured.
void WarnOfNoLidar(const RunOptions& options, const Localizer& localizer, const Context& context) {
  const LocalizerStatistics statistics = localizer.Statistics();
  if (FieldOfViewNamed(options.localizer.field_of_view) != FieldOfViewModel::kScanPolygon ||
      statistics.scans_by_lidar > 0) {
    return;
  }
  context.Warn(fmt::format("run log '{}': no lidar scan counted, the field of view was the sector",
                           options.run));
}

Status RunShift(const RunOptions& options, Context& context) {
  const bool is_stream = options.run == "-";
  const StopSignals signals(/*reads_end=*/is_stream);
  const LocalizerOptions localizer_options = options.localizer.Options();
  SHIFTMAP_RETURN_IF_ERROR(localizer_options.Validate());
  const std::string& map_path = options.store ? *options.store : *options.snapshot;
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore map_store,
                            OpenStore(map_path, MapStore::Access::kReadOnly, context));
  const auto map_at = [&](const RunInfo& info, Stamp begin) -> StatusOr<MapSnapshot> {
    SHIFTMAP_RETURN_IF_ERROR(CheckArea(options, info, context));
    return LoadMap(options, begin, &map_store, context);
  };

  const auto recording = context.dry_run() ? std::nullopt : options.recording;
  Shift shift(map_at, options.vehicle, recording, localizer_options);
  const Status taken =
      is_stream ? shift.ProcessStream(options.run) : shift.ProcessFile(options.run);
  // What came over a pipe does not come again: that shift ends here.
  if (!is_stream || !taken.ok()) {
    SHIFTMAP_RETURN_IF_ERROR(StopSignals::Check(fmt::format("run log '{}': run", options.run)));
  }
  SHIFTMAP_RETURN_IF_ERROR(taken);
  const ShiftReport report = shift.Finish();
  RunSummary summary = shift.summary();
  if (!summary.truncation.empty()) {
    context.Warn(fmt::format("run log '{}': {}", options.run, summary.truncation));
  }
  WarnOfImplausible(options.run, shift.localizer(), context);
  WarnOfGaps(options.run, shift.localizer(), context);
  WarnOfNoLidar(options, shift.localizer(), context);
  if (!context.dry_run()) {
    SHIFTMAP_ASSIGN_OR_RETURN(summary.returned, WriteResults(options, report, context, &shift));
  }
  context.Report(RunJson(shift.localizer(), summary), RunText(shift.localizer(), summary));
  if (shift.localizer().Statistics().localized()) return OkStatus();
  return ReportNotLocalized(options, summary, &map_store, &context);
}

}  // namespace

void AddRunCommand(Application* application) {
  auto options = std::make_shared<RunOptions>();
  Command& command =
      application->AddCommand("run",
                              "Localize a run log on a map and decide which modes hold",
                              [options](Context& context) { return RunShift(*options, context); });
  AddClockToleranceOption(&options->clock_tolerance_s, &command);
  AddLimitOptions(&options->localizer.limits, &command);
  command.Option("--store", &options->store, "Map store to take the published version from")
      .Option("--snapshot", &options->snapshot, "Snapshot file to take the map from")
      .Option("--area", &options->area, "Area to localize in")
      .Required()
      .Option("--initial-pose", &options->localizer.initial_pose, "X,Y,YAW in m, m, rad, or auto")
      .Option("--vehicle",
              &options->vehicle,
              "Vehicle whose calibration is used, and whose report it is if the log names none; "
              "default: as the log names it")
      .Option("--trajectory", &options->trajectory, "Write the trajectory here, TUM format")
      .Output()
      .Option("--report", &options->report, "Write the shift report here")
      .Output()
      .Option("--recording",
              &options->recording,
              "Record the shift here: MCAP for Foxglove, `plot consistency` and `view --replay`")
      .Output()
      .Flag("--return", &options->return_report, "Hand the shift report to the store at once");
  AddHypothesisOptions(&options->localizer, &command);
  command
      .Option(
          "--max-delay-s",
          &options->localizer.max_delay_s,
          "Put items of a stream in order that come this late; 0: one out of order ends the run")
      .InRange(0.0, 60.0)
      .Option("RUN", &options->run, "Run log, or - for standard input")
      .Required()
      .Check([options] { return CheckOptions(*options); })
      .Writes();
}

}  // namespace shiftmap
