// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "localizer/filter/event_buffer.h"
#include "localizer/filter/odometry_buffer.h"
#include "localizer/hypothesis/hypothesis_bank.h"
#include "localizer/localizer_options.h"
#include "localizer/localizer_state.h"
#include "localizer/monitor/change_monitor.h"
#include "localizer/monitor/health_monitor.h"
#include "localizer/monitor/innovation_quality.h"
#include "localizer/monitor/missed_passes.h"
#include "localizer/monitor/odometry_trust.h"
#include "localizer/monitor/recent_scans.h"
#include "localizer/monitor/sighting_collector.h"
#include "localizer/monitor/state_change.h"
#include "mapstore/map/map_scale.h"

namespace shiftmap {

/// The pose right after a scan.
struct PoseEstimate {
  Stamp stamp;
  PoseWithCovariance pose;
  double quality = 1.0;  ///< InnovationQuality::p_value().
};

/// One observation of a known signature against the heaviest leaf, with the time of its scan.
struct StampedOutcome {
  Stamp stamp;
  ObservationOutcome outcome;
};

/// What happened so far.
struct LocalizerStatistics {
  std::int64_t scans = 0;
  std::int64_t scans_by_lidar = 0;  ///< Whose field of view was that of a lidar's scan.
  /// By LocalizerState, without gaps. [s]
  std::array<double, kLocalizerStates> seconds_in_state = {};
  std::int64_t gaps = 0;     ///< Begin three seconds after the last odometry or scan.
  double gap_s = 0.0;        ///< In all gaps. [s]
  std::int64_t updates = 0;  ///< Observations that corrected the heaviest leaf; 2 dof each.
  double nis_sum = 0.0;      ///< Of their νᵀ S⁻¹ ν.
  std::int64_t starts = 0;   ///< Poses found or given; more than one: it was lost in between.
  bool localized() const { return starts > 0; }
  int leaves_max = 0;
  double dropped_mass_max = 0.0;

  // Observations that did not count, by reason.
  std::int64_t duplicate_signatures = 0;  ///< Alarms: one signature at two places in one scan.
  std::int64_t unknown_signatures = 0;    ///< The map has no such landmark.
  std::int64_t anonymous = 0;             ///< No signature.
  std::int64_t ungated = 0;               ///< At no place that the heaviest leaf holds possible.

  std::int64_t implausible_observations = 0;  ///< Beyond LocalizerOptions::limits.
  std::int64_t excess_observations = 0;       ///< Of unknown signatures, more than a scan may have.
  std::int64_t excess_places = 0;             ///< At places beyond LocalizerOptions::max_places.

  // Odometry samples and scans that did not count.
  std::int64_t implausible_odometry = 0;  ///< Beyond LocalizerOptions::limits.
  std::int64_t late = 0;                  ///< Older than what had been localized.
  std::int64_t jumped = 0;  ///< Far ahead of everything else; only if items may be late.
};

/// Localizes one vehicle on one map version, decides which mode of each landmark holds, and keeps
/// the evidence for the fleet. Method: T-IV III-VIII on a known map; localizer/METHOD.md.
///
/// Threads: none. Determinism: the same events give the same bits; with max_delay_s, whatever the
/// order in which they come within it. No I/O. Memory is bounded but for the evidence and decisions
/// that Report() returns; these records, changes of state and the search for a start
/// allocate, and other steps do not once they have seen as much at a time before.
class Localizer {
 public:
  /// @param options  Valid by Validate().
  Localizer(MapSnapshot snapshot, const LocalizerOptions& options);

  /// Takes in the next item of the log or of the live stream. What is beyond the limits is dropped
  /// and counted: the sample, or the observation of a scan.
  /// Errors: kInvalidArgument for what ValidateEvent rejects and for a stamp that is TooLate(); the
  /// localizer is then as before.
  Status Process(const RunEvent& event);

  /// True for stamps older than what was localized already.
  bool TooLate(Stamp stamp) const { return begin_ && stamp < now_; }

  /// Localizes what is held for items that may be late. These are too late from then on.
  void Flush();

  /// As Flush(), for a stream that pauses: see EventBuffer::FlushPaused().
  void FlushPaused();

  /// Starts again at the next scan, at a pose that somebody knows. What ended visits say stays.
  /// Flushes first.
  void Initialize(const PoseWithCovariance& pose);

  /// The pose after the last scan, by the heaviest leaf; nothing while INITIALIZING.
  std::optional<PoseEstimate> Estimate() const;

  /// The poses that the last Process() or Flush() made, one for every scan that was localized; when
  /// the first start was just found, also one for every scan that was kept for it. Their stamps
  /// ascend over all calls.
  const std::vector<PoseEstimate>& new_estimates() const { return new_estimates_; }

  /// The innovations of the scans of new_estimates(), in their order.
  const std::vector<StampedOutcome>& new_innovations() const { return new_innovations_; }

  /// The first item that was beyond the limits, to read; empty if none was.
  const std::string& first_implausible() const { return first_implausible_; }

  LocalizerState state() const { return state_; }

  /// False after landmarks have shown that odometry is wrong, until they have shown that it is
  /// right.
  bool odometry_trusted() const { return odometry_trust_.trusted(); }

  /// How many landmarks agree with the pose, by the last sighting of each, from `since` on.
  PoseSupport Support(Stamp since = Stamp::min()) const { return health_.Support(since, -1); }

  /// Changes of the state, oldest first, each with what it rests on; the last thousand.
  const std::deque<StateChange>& state_changes() const { return state_changes_; }
  LocalizerStatistics Statistics() const;

  /// The hypotheses, to look at; null while INITIALIZING.
  const HypothesisBank* hypotheses() const { return bank_ ? &*bank_ : nullptr; }

  /// Probability of each state of a group now; size n + 1.
  Eigen::VectorXd Probabilities(int group) const;

  const std::vector<Decision>& decisions() const { return decisions_; }

  /// Those that the last Process() or Flush() made. A new start takes back decisions since the pose
  /// was wrong, and makes them anew.
  const std::vector<Decision>& new_decisions() const { return new_decisions_; }
  std::vector<UnmappedSighting> Sightings() const { return sightings_.Sightings(); }
  const MapSnapshot& snapshot() const { return snapshot_; }

  /// Ends the shift: flushes, closes all visits. Process() may not be called after it.
  void Finish();

  /// What the fleet is told. uuid, vehicle, run_hash and software are the caller's to fill in.
  ShiftReport Report() const;

 private:
  void Localize(const OdometrySample& sample);
  void Localize(const Scan& scan);
  void Localize(const LidarScan& scan);
  void LocalizeDue();
  void ProcessScan(const Scan& scan);
  void TakeUsableObservations(const Scan& scan);
  void CollectNamed(const Scan& scan);
  void BoundWindow(Stamp now);
  void Step(const WindowScan& step);
  void TryGlobalStart();
  void ForgetOutcomes();
  void StartAt(const PoseWithCovariance& pose, std::size_t first);
  void TakeBackEstimate(Stamp stamp);

  // Takes back what was concluded from scans that are about to be replayed with another pose: they
  // must not count twice, and what a lost vehicle saw is no evidence.
  void ForgetSince(Stamp stamp);

  void JudgeOdometry(const BankEvents& events);
  void JudgeOutcomes(const Scan& scan, const BankEvents& events);
  void JudgeDecisions(const BankEvents& events, Stamp stamp);
  SightingCollector::PlaceState Collect(const Observation& observation, Stamp stamp);
  void JudgeMisses(const Scan& scan, const BankEvents& events);
  bool Explains(const ObservationOutcome& outcome, const Scan& scan);
  bool NearAMode(int group, const SightingCollector::PlaceState& place) const;
  // Returns since when the pose is not to be trusted.
  Stamp DistrustPose(Stamp failing_since);
  void ForgetNew();
  // Nobody knows what the vehicle does in a gap: the pose is lost there, by no fault of the map.
  void AccountTime(Stamp stamp);
  LocalizerState JudgeState() const;

  // Most landmarks seen since the start contradict a pose that was given.
  bool StartsInDoubt() const { return given_ && health_.Doubts(); }
  void SetState(LocalizerState state);

  // A leaf at another pose that competes with the present one.
  struct RivalPose {
    Se2 T_odom_vehicle;  // When it was found.
    Se2 T_map_here;      // Of the vehicle then, by either.
    Se2 T_map_there;
    Stamp since;  // When the one failed.
  };
  void FindRival(Stamp stamp);
  void Consider(const PoseWithCovariance& there, Stamp since);
  void JudgeRival();
  // Dead reckoning does not connect the scan at the end of a motion with those before it.
  bool BreaksReckoning(const OdometryBuffer::Motion& motion) const;
  std::vector<WindowScan> Window() const { return {window_.begin(), window_.end()}; }
  void BeginWay(Stamp stamp);
  void ReviewStart(Stamp stamp);

  // As published: with what the map's scale is uncertain by.
  PoseWithCovariance WithMapScale(PoseWithCovariance pose) const;

  MapScale scale_;        // Removed from
  MapSnapshot snapshot_;  // the map.
  LocalizerOptions options_;
  std::optional<EventBuffer> buffer_;  // If items may be late.
  ItemLimits limits_;
  OdometryBuffer odometry_;
  std::optional<HypothesisBank> bank_;
  std::optional<PoseWithCovariance> next_start_;  // Given, for the next scan.
  WindowScan step_;                               // The present scan.
  std::vector<const Observation*> by_signature_;  // Scratch.
  std::deque<WindowScan> window_;  // Scans kept for a start: INITIALIZING and LOST only.
  RecentScans recent_;
  RecentScans way_;  // Of the last half minute and more, since the start at most.
  Stamp started_;
  Stamp next_review_;  // Of the start.
  HealthMonitor health_;
  ChangeMonitor changes_;
  MissedPasses missed_;
  OdometryTrust odometry_trust_;
  InnovationQuality quality_;
  SightingCollector sightings_;
  LocalizerState state_ = LocalizerState::kInitializing;
  LocalizerStatistics statistics_;
  std::vector<VisitEvidence> evidence_;
  std::vector<Decision> decisions_;
  std::vector<Decision> new_decisions_;
  std::vector<PoseEstimate> new_estimates_;
  std::vector<StampedOutcome> new_innovations_;
  std::optional<Stamp> newest_estimate_;
  std::optional<Stamp> begin_;  // Of the first event.
  Stamp now_;                   // Of the last event.
  Stamp heard_;                 // Of the last odometry or scan.
  bool in_gap_ = false;         // Until a scan tells the heading again.
  bool vague_ = false;          // The pose, beyond LocalizerOptions::max_position_sd_m.
  bool given_ = false;          // The pose, and landmarks have not spoken for it.
  Stamp scan_stamp_;            // Of the last scan.
  Stamp confirmed_;             // The pose, last; else its start.
  std::optional<RivalPose> rival_;
  std::optional<StateEvidence> mode_changed_;    // The last one.
  std::optional<StateEvidence> unknown_change_;  // The last one.
  std::set<Signature> at_two_places_;            // Of the map's.
  std::string first_implausible_;
  std::deque<StateChange> state_changes_;
};

}  // namespace shiftmap
