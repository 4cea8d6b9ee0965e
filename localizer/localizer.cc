// SPDX-License-Identifier: Apache-2.0
#include "localizer/localizer.h"

#include <algorithm>
#include <utility>
#include <variant>

#include "localizer/filter/unknown_places.h"
#include "localizer/models/observation_model.h"
#include "localizer/monitor/landmark_distances.h"
#include "localizer/monitor/wrong_pose.h"
#include "mapstore/geometry/covariance.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

// One signature seen further apart than this is at two places.
constexpr double kDuplicateSigmas = 5.0;

// With a heading less certain than this the filter, which is linear, misplaces what it sees. [rad]
constexpr double kMaxYawSd = 0.7;

// A vehicle that looks anywhere sees every landmark at some place or other. [rad]
constexpr double kNoYawSd = 1.5;

// A pose that was too vague is trusted again below this share of the limit.
constexpr double kNoLongerVague = 0.5;

// A landmark that is expected no better than this agrees with more than one pose. [m]
constexpr double kMaxExactSd = 0.3;

// One of two poses is given up when it is less likely.
constexpr double kGivenUp = 1e-3;

// A start is questioned every few seconds, and again a minute after another pose was considered.
constexpr Duration kReviewPeriod = std::chrono::seconds(2);
constexpr Duration kReviewedPeriod = std::chrono::seconds(60);

// Of the scans that question it.
constexpr RecentScans::Spacing kWaySpacing{0.5, 0.1, 0.05};

// Observations of signatures that the map does not know: per scan, and of all kinds in the scans
// that wait for a start.
constexpr std::size_t kMaxUnknown = 256;
constexpr std::size_t kMaxWindowObservations = 100'000;
constexpr std::size_t kMaxWindowBeams = 2'000'000;

std::string Describe(const OdometrySample& sample) {
  return fmt::format("odometry at {:.6f} s: v = {} m/s, omega = {} rad/s",
                     ToSecondsSinceEpoch(sample.stamp),
                     sample.v_mps,
                     sample.omega_radps);
}

std::string Describe(const Observation& observation, Stamp stamp) {
  return fmt::format("scan at {:.6f} s: landmark '{}': z = ({}, {}){}",
                     ToSecondsSinceEpoch(stamp),
                     observation.signature.text(),
                     observation.z.x(),
                     observation.z.y(),
                     observation.cov_z ? ", or its covariance" : "");
}

// The heading is unknown; or odometry is silent, and it soon will be.
bool HasNoHeading(const OdometryBuffer::Motion& motion, const PoseWithCovariance& pose) {
  const double limit = motion.silent_s > 0.0 ? kMaxYawSd : kNoYawSd;
  return pose.cov_T_map_vehicle(2, 2) > limit * limit;
}

// The position is too uncertain to know which landmarks are in reach: sightings may agree with any
// pose.
bool HasNoPlace(const HypothesisBank& bank, const SensorCalibration& sensor) {
  const PoseWithCovariance pose = bank.best().filter.Pose();
  const double limit = sensor.max_range_m * sensor.max_range_m;
  if (IsNowhere(pose)) return true;
  if (pose.cov_T_map_vehicle.topLeftCorner<2, 2>().trace() <= limit) return false;
  const double sd = bank.SdAmongLandmarks();
  return 2.0 * sd * sd > limit;
}

// True if the position among the landmarks is less certain than `limit_m` in some direction.
bool IsVague(const HypothesisBank& bank, const PoseWithCovariance& pose, double limit_m) {
  const Eigen::Matrix2d cov = pose.cov_T_map_vehicle.topLeftCorner<2, 2>();
  if (LargestSd(cov) <= limit_m) return false;
  const PoseWithCovariance best = bank.best().filter.Pose();
  const double of_leaves = LargestSd(cov - best.cov_T_map_vehicle.topLeftCorner<2, 2>());
  return std::hypot(bank.SdAmongLandmarks(), of_leaves) > limit_m;
}

// One landmark leaves open where about it the vehicle is.
bool Determines(const std::vector<ObservationOutcome>& outcomes) {
  return std::count_if(outcomes.begin(), outcomes.end(), [](const ObservationOutcome& outcome) {
           return outcome.gated;
         }) >= 2;
}

bool AtTwoPlaces(const Observation& a, const Observation& b, const SensorCalibration& sensor) {
  const Eigen::Matrix2d cov = PositionNoiseInVehicle(a, ObservationNoise(a, sensor)) +
                              PositionNoiseInVehicle(b, ObservationNoise(b, sensor));
  return SquaredMahalanobis(a.PositionInVehicle() - b.PositionInVehicle(), cov) >
         kDuplicateSigmas * kDuplicateSigmas;
}

// The map without what its scale is uncertain by: the vehicle's ranges and odometry are calibrated
// in the map's units.
MapSnapshot InOwnUnits(MapSnapshot snapshot, MapScale* scale) {
  MapContent content = snapshot.content();
  *scale = RemoveScale(KnownMapFilter::kSdLogRangeScale, &content);
  if (scale->sd == 0.0) return snapshot;
  return MapSnapshot(snapshot.area(),
                     snapshot.version(),
                     snapshot.content_hash(),
                     std::move(content),
                     snapshot.ledger_position(),
                     snapshot.aliases())
      .ForVehicle(snapshot.calibrated_vehicle());
}

}  // namespace

Localizer::Localizer(MapSnapshot snapshot, const LocalizerOptions& options)
    : snapshot_(InOwnUnits(std::move(snapshot), &scale_)),
      options_(options),
      limits_(options.limits.For(snapshot_.calibration().sensor)),
      odometry_(snapshot_.calibration().odometry),
      next_start_(options.initial_pose),
      way_(kWaySpacing),
      health_(snapshot_.groups().size(), options.health),
      changes_(snapshot_.groups().size(), options.min_sightings),
      missed_(snapshot_),
      sightings_(options.max_places) {
  const Status valid = options.Validate();
  SHIFTMAP_CHECK(valid.ok(), "{}", Message(valid));
  const Duration max_delay = FromSeconds(options.max_delay_s);
  if (max_delay > Duration::zero()) buffer_.emplace(max_delay);
}

Status Localizer::Process(const RunEvent& event) {
  SHIFTMAP_RETURN_IF_ERROR(ValidateEvent(event));
  const Stamp stamp = StampOf(event);
  if (TooLate(stamp)) {
    ++statistics_.late;
    return InvalidArgument("event at {:.6f} s comes after one at {:.6f} s, expected time order",
                           ToSecondsSinceEpoch(stamp),
                           ToSecondsSinceEpoch(now_));
  }
  ForgetNew();
  const auto* sample = std::get_if<OdometrySample>(&event);
  if (sample != nullptr && !IsPlausible(*sample, limits_)) {
    ++statistics_.implausible_odometry;
    if (first_implausible_.empty()) first_implausible_ = Describe(*sample);
    return OkStatus();
  }
  if (buffer_) {
    buffer_->Add(event);
    LocalizeDue();
  } else {
    std::visit([&](const auto& item) { Localize(item); }, event);
  }
  return OkStatus();
}

void Localizer::Flush() {
  ForgetNew();
  if (!buffer_) return;
  buffer_->Flush();
  LocalizeDue();
}

void Localizer::FlushPaused() {
  ForgetNew();
  if (!buffer_) return;
  buffer_->FlushPaused();
  LocalizeDue();
}

void Localizer::ForgetNew() {
  new_estimates_.clear();
  new_innovations_.clear();
  new_decisions_.clear();
}

void Localizer::LocalizeDue() {
  while (const HeldEvent* due = buffer_->Next()) {
    due->Visit([&](const auto& item) { Localize(item); });
  }
}

void Localizer::Localize(const OdometrySample& sample) {
  AccountTime(sample.stamp);
  heard_ = sample.stamp;
  odometry_.Add(sample);
  SetState(JudgeState());
}

void Localizer::Localize(const Scan& scan) {
  AccountTime(scan.stamp);
  heard_ = scan.stamp;
  ProcessScan(scan);
  SetState(JudgeState());
}

void Localizer::Localize(const LidarScan& scan) {
  AccountTime(scan.stamp);
  if (options_.hypotheses.field_of_view.model == FieldOfViewModel::kScanPolygon) {
    step_.lidar.Take(scan);
  }
  SetState(JudgeState());
}

void Localizer::AccountTime(Stamp stamp) {
  if (!begin_) begin_ = now_ = heard_ = stamp;
  const Stamp gap_begin = heard_ + OdometryBuffer::SilenceUntil(kMaxYawSd);
  const Stamp told_until = std::clamp(gap_begin, now_, stamp);
  statistics_.seconds_in_state[static_cast<std::size_t>(state_)] += ToSeconds(told_until - now_);
  if (stamp > gap_begin) {
    if (now_ <= gap_begin) ++statistics_.gaps;
    statistics_.gap_s += ToSeconds(stamp - told_until);
    now_ = told_until;
    in_gap_ = true;
    SetState(JudgeState());
  }
  now_ = stamp;
}

void Localizer::ProcessScan(const Scan& scan) {
  ++statistics_.scans;
  TakeUsableObservations(scan);
  step_.motion = odometry_.Take(scan.stamp);
  odometry_trust_.Move(step_.motion.increment.T_begin_end);
  step_.lidar.Move(step_.motion.increment.T_begin_end,
                   step_.motion.elapsed_s,
                   scan.stamp,
                   options_.hypotheses.field_of_view.max_lidar_age_s);
  if (step_.lidar.counts) ++statistics_.scans_by_lidar;
  if (next_start_) {
    window_.clear();
    window_.push_back(step_);
    StartAt(*std::exchange(next_start_, std::nullopt), 0);
    given_ = !health_.Confirms();
    return;
  }
  const bool searching = !bank_ || health_.lost();
  if (bank_) Step(step_);
  if (bank_ && !health_.lost()) {
    window_.clear();
    return;
  }
  if (searching) {
    if (step_.motion.silent_s > 0.0) window_.clear();
    window_.push_back(step_);
    // Odometry that was wrong may be right by now: wheels slip and grip again.
    if (!odometry_trust_.trusted() && ContradictsOdometry(Window(), snapshot_, 1)) {
      window_.erase(window_.begin(), window_.end() - 1);
    }
  } else {
    // Just lost: what failed tells where the vehicle is.
    const std::vector<WindowScan> failing = recent_.Since(health_.failing_since());
    window_.assign(failing.begin(), failing.end());
  }
  BoundWindow(scan.stamp);
  // The scan that shows that the pose is lost is reported as such.
  if (searching && !window_.back().scan.observations.empty()) TryGlobalStart();
}

void Localizer::BoundWindow(Stamp now) {
  const Duration kept = FromSeconds(options_.global_start.window_s);
  std::size_t observations = 0;
  std::size_t beams = 0;
  for (const WindowScan& scan : window_) {
    observations += scan.scan.observations.size();
    beams += scan.lidar.scan.ranges_m.size();
  }
  const auto full = [&] {
    return observations > kMaxWindowObservations || beams > kMaxWindowBeams;
  };
  while (window_.front().scan.stamp < now - kept || (full() && window_.size() > 1)) {
    observations -= window_.front().scan.observations.size();
    beams -= window_.front().lidar.scan.ranges_m.size();
    window_.pop_front();
  }
}

void Localizer::CollectNamed(const Scan& scan) {
  by_signature_.clear();
  std::size_t unknown = 0;
  for (const Observation& observation : scan.observations) {
    if (!IsPlausible(observation, limits_)) {
      ++statistics_.implausible_observations;
      if (first_implausible_.empty()) first_implausible_ = Describe(observation, scan.stamp);
    } else if (observation.signature.anonymous()) {
      ++statistics_.anonymous;
    } else if (snapshot_.GroupIndex(observation.signature) < 0 && ++unknown > kMaxUnknown) {
      ++statistics_.excess_observations;
    } else {
      by_signature_.push_back(&observation);
    }
  }
}

void Localizer::TakeUsableObservations(const Scan& scan) {
  CollectNamed(scan);
  // Those of one signature side by side, in the order of the scan.
  std::sort(by_signature_.begin(), by_signature_.end(), [](const auto* a, const auto* b) {
    const int order = a->signature.text().compare(b->signature.text());
    return order != 0 ? order < 0 : a < b;
  });
  const SensorCalibration& sensor = snapshot_.calibration().sensor;
  const auto end = by_signature_.end();
  auto kept = by_signature_.begin();
  for (auto first = by_signature_.begin(); first != end;) {
    const auto next = std::find_if(first, end, [&](const Observation* other) {
      return other->signature != (*first)->signature;
    });
    const Observation* const seen = *first;
    if (std::any_of(first + 1, next, [&](const Observation* other) {
          return AtTwoPlaces(*seen, *other, sensor);
        })) {
      ++statistics_.duplicate_signatures;
      if (snapshot_.GroupIndex(seen->signature) >= 0) at_two_places_.insert(seen->signature);
    } else {
      *kept++ = seen;
    }
    first = next;
  }
  std::sort(by_signature_.begin(), kept);
  step_.scan.stamp = scan.stamp;
  step_.scan.observations.resize(static_cast<std::size_t>(kept - by_signature_.begin()));
  for (std::size_t i = 0; i < step_.scan.observations.size(); ++i) {
    step_.scan.observations[i] = Corrected(*by_signature_[i], sensor);
  }
}

void Localizer::Step(const WindowScan& step) {
  recent_.Add(step);
  if (BreaksReckoning(step.motion)) way_.Clear();
  way_.Add(step);
  bank_->Predict(step.motion.increment, step.motion.elapsed_s);
  const SensorCalibration& sensor = snapshot_.calibration().sensor;
  const bool had_no_place = HasNoPlace(*bank_, sensor);
  const BankEvents& events = bank_->Correct(step.scan, &step.lidar);
  scan_stamp_ = step.scan.stamp;

  JudgeOutcomes(step.scan, events);
  if (step.scan.stamp == now_) JudgeOdometry(events);
  const PoseWithCovariance best = bank_->best().filter.Pose();
  const PoseWithCovariance pose = bank_->Pose();
  vague_ = IsVague(*bank_, pose, options_.max_position_sd_m * (vague_ ? kNoLongerVague : 1.0));
  const bool unlocalized =
      had_no_place || HasNoPlace(*bank_, sensor) || HasNoHeading(step.motion, best);
  if (!health_.lost() && unlocalized) {
    health_.DeclareLost(step.scan.stamp);
    DistrustPose(health_.failing_since());
  }
  if (best.cov_T_map_vehicle(2, 2) <= kMaxYawSd * kMaxYawSd) in_gap_ = false;
  JudgeMisses(step.scan, events);
  JudgeDecisions(events, step.scan.stamp);
  evidence_.insert(evidence_.end(), events.evidence.begin(), events.evidence.end());
  for (const TreeDecision& made : events.decisions) {
    decisions_.push_back(made.decision);
    new_decisions_.push_back(made.decision);
  }
  // A restart replays scans that have had their estimate.
  if (!newest_estimate_ || step.scan.stamp > *newest_estimate_) {
    newest_estimate_ = step.scan.stamp;
    new_estimates_.push_back({step.scan.stamp, WithMapScale(pose), quality_.p_value()});
    for (const ObservationOutcome& outcome : events.outcomes) {
      new_innovations_.push_back({step.scan.stamp, outcome});
    }
  }
}

// By the present scan.
void Localizer::JudgeOdometry(const BankEvents& events) {
  if (!health_.lost() && Determines(events.outcomes)) {
    odometry_.PoseDetermined();
    odometry_trust_.Compare(bank_->best().filter.Pose());
  }
  odometry_.Trust(odometry_trust_.trusted());
}

void Localizer::JudgeOutcomes(const Scan& scan, const BankEvents& events) {
  const bool was_lost = health_.lost();
  if (!was_lost) {
    health_.AddPairs(scan.stamp, CompareDistances(scan, events.outcomes, snapshot_));
  }
  for (const Observation& observation : scan.observations) {
    if (snapshot_.GroupIndex(observation.signature) >= 0) continue;
    ++statistics_.unknown_signatures;
    if (!was_lost) Collect(observation, scan.stamp);
  }
  for (const ObservationOutcome& outcome : events.outcomes) {
    if (outcome.gated) {
      ++statistics_.updates;
      statistics_.nis_sum += outcome.nis;
      quality_.Add(outcome.nis);
    } else {
      ++statistics_.ungated;
    }
    const bool explained = Explains(outcome, scan);
    const auto nis = outcome.gated ? std::optional(outcome.nis) : std::nullopt;
    const bool vague = outcome.gated && outcome.S.trace() > 2.0 * kMaxExactSd * kMaxExactSd;
    health_.Add(scan.stamp, outcome.group, explained, nis, vague);
  }
  health_.Judge();
  if (!health_.lost()) {
    if (health_.Confirms() && !rival_) confirmed_ = scan.stamp;
    if (was_lost || health_.Confirms() || (health_.Doubts() && health_.LandmarksMoved())) {
      given_ = false;
    }
    if (!rival_) FindRival(scan.stamp);
  }
  if (rival_) JudgeRival();
  if (health_.lost() && !was_lost) DistrustPose(health_.failing_since());
}

void Localizer::FindRival(Stamp stamp) {
  const auto fault = FindWrongPose({bank_->best().filter.Pose(), stamp, recent_, health_},
                                   snapshot_,
                                   bank_->field_of_view(),
                                   options_.global_start);
  if (!fault) {
    ReviewStart(stamp);
  } else if (fault->rival) {
    Consider(*fault->rival, fault->since);
  } else {
    health_.DeclareLost(fault->since);
    if (fault->odometry) odometry_trust_.Distrust();
  }
}

bool Localizer::BreaksReckoning(const OdometryBuffer::Motion& motion) const {
  return motion.silent_s > 0.0 || !odometry_trust_.trusted();
}

void Localizer::BeginWay(Stamp stamp) {
  way_.Clear();
  started_ = stamp;
  next_review_ = stamp + kReviewPeriod;
}

void Localizer::ReviewStart(Stamp stamp) {
  if (stamp < next_review_) return;
  next_review_ = stamp + kReviewPeriod;
  const auto other = FindOtherStart({bank_->best().filter.Pose(), stamp, way_, health_},
                                    started_,
                                    snapshot_,
                                    options_.global_start);
  if (!other) return;
  Consider(*other, started_);
  if (rival_) next_review_ = stamp + kReviewedPeriod;
}

void Localizer::Consider(const PoseWithCovariance& there, Stamp since) {
  const Se2 T_map_here = bank_->best().filter.T_map_vehicle();
  if (!bank_->Consider(there)) return;
  rival_ = {bank_->T_odom_vehicle(), T_map_here, there.T_map_vehicle, since};
}

void Localizer::JudgeRival() {
  const Se2 moved = rival_->T_odom_vehicle.Inverse() * bank_->T_odom_vehicle();
  const double there = bank_->ShareNearer((rival_->T_map_there * moved).translation(),
                                          (rival_->T_map_here * moved).translation());
  if (there > kGivenUp && there < 1.0 - kGivenUp) return;
  if (there > 0.5) {
    ++statistics_.starts;
    DistrustPose(rival_->since);
    ForgetOutcomes();
    BeginWay(scan_stamp_);
  }
  rival_.reset();
}

void Localizer::JudgeMisses(const Scan& scan, const BankEvents& events) {
  const bool explained = std::any_of(
      events.outcomes.begin(), events.outcomes.end(), [](const ObservationOutcome& outcome) {
        return outcome.gated_any;
      });
  // A sensor may log nothing where it sees nothing, and what a lost vehicle misses says nothing.
  if (!explained || health_.lost()) return;
  for (const int group : missed_.Add(scan, *bank_, snapshot_)) changes_.Missed(group, scan.stamp);
}

bool Localizer::Explains(const ObservationOutcome& outcome, const Scan& scan) {
  if (outcome.gated_any) {
    changes_.Explained(outcome.group);
    return true;
  }
  if (health_.lost()) return false;
  const Observation& observation = scan.observations[outcome.index];
  const SightingCollector::PlaceState place = Collect(observation, scan.stamp);
  const bool at_two_places = at_two_places_.contains(observation.signature);
  const auto support = changes_.Sighted(outcome.group, place, health_);
  if (!support || at_two_places || NearAMode(outcome.group, place)) return place.confirmed;
  sightings_.Confirm(observation.signature, place.place);
  StateEvidence evidence;
  evidence.stamp = scan.stamp;
  evidence.signature = observation.signature;
  evidence.sightings = place.count;
  evidence.support = *support;
  unknown_change_ = evidence;
  return true;
}

bool Localizer::NearAMode(int group, const SightingCollector::PlaceState& place) const {
  const std::vector<Mode>& modes = snapshot_.groups()[static_cast<std::size_t>(group)].modes;
  return std::any_of(modes.begin(), modes.end(), [&](const Mode& mode) {
    return (mode.p_map_landmark - place.p_map).norm() < kMinDisplacement;
  });
}

void Localizer::JudgeDecisions(const BankEvents& events, Stamp stamp) {
  StateEvidence evidence;
  evidence.stamp = stamp;
  for (const auto& [decision, surprising] : events.decisions) {
    const bool absent = decision.mode == kAbsent;
    const int group = snapshot_.GroupIndex(decision.signature);
    // One that is seen elsewhere is for ChangeMonitor::Sighted() to judge, which takes longer: the
    // pose may have just been found, and what was seen before it was lost is at unknown places.
    const bool seen = std::any_of(
        events.outcomes.begin(), events.outcomes.end(), [&](const ObservationOutcome& outcome) {
          return outcome.group == group;
        });
    const bool gone = absent && surprising && !seen;
    changes_.Decided(group, gone && !at_two_places_.contains(decision.signature), stamp);
    if (absent || !surprising) continue;
    evidence.signature = decision.signature;
    evidence.mode = decision.mode;
    evidence.log_odds = decision.log_odds;
    evidence.support = health_.Support();
    mode_changed_ = evidence;
  }
  if (health_.lost()) return;
  while (const auto gone = changes_.TakeGone(health_, stamp)) {
    evidence.signature = snapshot_.groups()[static_cast<std::size_t>(gone->group)].signature;
    evidence.mode = kAbsent;
    evidence.support = gone->support;
    unknown_change_ = evidence;
  }
}

SightingCollector::PlaceState Localizer::Collect(const Observation& observation, Stamp stamp) {
  const KnownMapFilter& filter = bank_->best().filter;
  const PoseWithCovariance pose = filter.Pose();
  const KnownMapFilter::Measurement measurement = filter.WithoutScale(KnownMapFilter::Measure(
      observation, ObservationNoise(observation, snapshot_.calibration().sensor)));
  const Eigen::Vector2d& q = measurement.q;
  constexpr int kScale = KnownMapFilter::kRangeScale;
  Eigen::Matrix<double, 2, 3> dq_dxi;
  dq_dxi << 1.0, 0.0, -q.y(), 0.0, 1.0, q.x();
  const Eigen::Matrix2d R = pose.T_map_vehicle.Rotation();
  const Eigen::Matrix2d cov_vehicle = measurement.cov_noise +
                                      dq_dxi * pose.cov_T_map_vehicle * dq_dxi.transpose() +
                                      filter.covariance()(kScale, kScale) * q * q.transpose();
  return sightings_.Add(observation.signature,
                        pose.T_map_vehicle * q,
                        Symmetrized(R * cov_vehicle * R.transpose()),
                        bank_->T_odom_vehicle().translation(),
                        stamp);
}

// Since when it failed is known; since when it was wrong is not, but not since it was confirmed.
Stamp Localizer::DistrustPose(Stamp failing_since) {
  const Stamp since = std::min(confirmed_, failing_since);
  ForgetSince(since);
  sightings_.ForgetSince(since);
  changes_.Reset();
  missed_.Reset();
  if (mode_changed_ && mode_changed_->stamp >= since) mode_changed_.reset();
  if (unknown_change_ && unknown_change_->stamp >= since) unknown_change_.reset();
  return since;
}

void Localizer::TryGlobalStart() {
  if (rival_) return;
  const std::vector<WindowScan> window = Window();
  const auto start = FindRecentStart(window, snapshot_, options_.global_start);
  if (!start) return;
  if (bank_ && !health_.wrong()) {
    Consider(PoseAtEnd(*start, window), health_.failing_since());
  } else {
    std::vector<Se2> motions;
    for (std::size_t i = 1; i < window.size(); ++i) {
      motions.push_back(window[i].motion.increment.T_begin_end);
    }
    odometry_trust_.Agree(motions);
    StartAt(start->pose, start->scan);
    health_.MarkStart();
  }
}

void Localizer::ForgetOutcomes() {
  health_.Reset();
  changes_.Reset();
  missed_.Reset();
  quality_.Reset();
  odometry_trust_.Restart();
  given_ = false;
}

void Localizer::StartAt(const PoseWithCovariance& pose, std::size_t first) {
  const Stamp stamp = window_[first].scan.stamp;
  if (bank_) {
    const Stamp wrong_since = health_.lost() ? DistrustPose(health_.failing_since()) : Stamp::max();
    bank_->Restart(pose, stamp, wrong_since);
    ForgetSince(stamp);
  } else {
    bank_.emplace(snapshot_, options_.hypotheses, pose, stamp);
  }
  confirmed_ = stamp;
  in_gap_ = false;
  vague_ = false;
  rival_.reset();
  ++statistics_.starts;
  ForgetOutcomes();
  recent_.Clear();
  BeginWay(stamp);
  const std::deque<WindowScan> replayed = std::exchange(window_, {});
  TakeBackEstimate(replayed.back().scan.stamp);
  for (std::size_t i = first; i < replayed.size(); ++i) {
    WindowScan step = replayed[i];
    if (i == first) step.motion = {};
    Step(step);
  }
}

// A scan that finds another pose gets its estimate from the replay with that pose.
void Localizer::TakeBackEstimate(Stamp stamp) {
  if (new_estimates_.empty() || new_estimates_.back().stamp != stamp) return;
  new_estimates_.pop_back();
  std::erase_if(new_innovations_, [&](const auto& told) { return told.stamp == stamp; });
  newest_estimate_ = stamp - Duration(1);
}

void Localizer::ForgetSince(Stamp stamp) {
  std::erase_if(evidence_, [&](const VisitEvidence& evidence) { return evidence.end >= stamp; });
  const auto is_since = [&](const Decision& decision) { return decision.stamp >= stamp; };
  std::erase_if(decisions_, is_since);
  std::erase_if(new_decisions_, is_since);
}

void Localizer::Initialize(const PoseWithCovariance& pose) {
  Flush();
  next_start_ = pose;
}

std::optional<PoseEstimate> Localizer::Estimate() const {
  if (!bank_) return std::nullopt;
  return PoseEstimate{scan_stamp_, WithMapScale(bank_->Pose()), quality_.p_value()};
}

PoseWithCovariance Localizer::WithMapScale(PoseWithCovariance pose) const {
  const Se2& T_map_vehicle = pose.T_map_vehicle;
  const Eigen::Vector2d q =
      T_map_vehicle.Rotation().transpose() * (T_map_vehicle.translation() - scale_.p_map_centroid);
  pose.cov_T_map_vehicle.topLeftCorner<2, 2>() += scale_.sd * scale_.sd * q * q.transpose();
  return pose;
}

LocalizerStatistics Localizer::Statistics() const {
  LocalizerStatistics statistics = statistics_;
  statistics.excess_places = sightings_.not_kept();
  if (buffer_) statistics.jumped = buffer_->jumps();
  if (bank_) {
    statistics.leaves_max = bank_->leaves_max();
    statistics.dropped_mass_max = bank_->dropped_mass_max();
  }
  return statistics;
}

Eigen::VectorXd Localizer::Probabilities(int group) const {
  if (bank_) return bank_->Probabilities(group);
  return snapshot_.groups()[static_cast<std::size_t>(group)].probabilities;
}

LocalizerState Localizer::JudgeState() const {
  if (!bank_) return LocalizerState::kInitializing;
  if (health_.lost() || health_.unproven() || rival_ || in_gap_ || vague_ || StartsInDoubt()) {
    return LocalizerState::kLost;
  }
  const Duration hold = FromSeconds(options_.state_hold_s);
  const auto recent = [&](const std::optional<StateEvidence>& cause) {
    return cause && now_ - cause->stamp <= hold;
  };
  if (recent(unknown_change_)) return LocalizerState::kUnknownChange;
  if (recent(mode_changed_)) return LocalizerState::kModeChanged;
  return LocalizerState::kTracking;
}

void Localizer::SetState(LocalizerState state) {
  if (state == state_) return;
  constexpr std::size_t kMaxChanges = 1000;
  if (state_changes_.size() == kMaxChanges) state_changes_.pop_front();
  StateEvidence evidence;
  if (state == LocalizerState::kUnknownChange) {
    evidence = *unknown_change_;
  } else if (state == LocalizerState::kModeChanged) {
    evidence = *mode_changed_;
  } else {
    evidence.stamp = now_;
    const Stamp failing_since = rival_ ? rival_->since : health_.failing_since();
    const bool failed = health_.lost() || rival_;
    evidence.support = failed               ? health_.Support(failing_since, -1)
                       : health_.unproven() ? *health_.unproven()
                                            : health_.Support();
  }
  state_changes_.push_back({now_, state_, state, evidence});
  state_ = state;
}

void Localizer::Finish() {
  Flush();
  if (!bank_) return;
  std::vector<VisitEvidence> last = bank_->EndVisits();
  evidence_.insert(evidence_.end(), last.begin(), last.end());
  if (StartsInDoubt()) DistrustPose(now_);
}

ShiftReport Localizer::Report() const {
  ShiftReport report;
  report.area = snapshot_.area();
  report.version = snapshot_.version();
  report.content_hash = snapshot_.content_hash();
  report.begin = begin_.value_or(Stamp());
  report.end = now_;
  report.evidence = evidence_;
  report.decisions = decisions_;
  report.sightings = sightings_.Sightings();
  return report;
}

}  // namespace shiftmap
