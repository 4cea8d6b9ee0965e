// SPDX-License-Identifier: Apache-2.0
#include "mapper/association/anonymous_tracks.h"

#include <algorithm>
#include <limits>
#include <map>
#include <utility>

#include "localizer/models/motion_model.h"
#include "localizer/models/observation_model.h"
#include "mapper/association/slam_association.h"
#include "mapper/frontend/gated_landmarks.h"
#include "mapper/frontend/slam_state.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// Scans between two looks for duplicates.
constexpr int kDuplicatePeriod = 25;

struct Sighted {
  int scan = 0;
  int observation = 0;
};

struct Track {
  std::vector<Sighted> seen;  // By scan.
  bool confirmed = false;
};

bool SeenTogether(const Track& a, const Track& b) {
  auto i = a.seen.begin();
  auto j = b.seen.begin();
  while (i != a.seen.end() && j != b.seen.end()) {
    if (i->scan == j->scan) return true;
    if (i->scan < j->scan) {
      ++i;
    } else {
      ++j;
    }
  }
  return false;
}

class Tracker {
 public:
  Tracker(const Calibration& calibration,
          const AssociationOptions& options,
          const FrontEndOptions& front_end)
      : options_(options),
        front_end_(front_end),
        gate_(ChiSquareQuantile(options.compatibility.gate_probability, 2)),
        isolation_gate_(ChiSquareQuantile(options.isolation_probability, 2)),
        sensor_(calibration.sensor),
        state_(calibration) {}

  const Se2& pose() const { return state_.pose(); }
  OdometryCalibration Odometry() const { return state_.Odometry(); }
  void Predict(const MotionIncrement& motion) { state_.Predict(motion); }

  // A scan of which what the sensor gets wrong is known.
  void Take(Scan scan, int index) {
    for (Observation& observation : scan.observations) {
      observation = Corrected(observation, sensor_);
    }
    const UsableSightings usable = FindUsableSightings(scan, front_end_);
    std::vector<int> free = usable.anonymous;  // Observations without signature and track.
    double range_m = 0.0;
    for (const Observation& observation : scan.observations) {
      range_m = std::max(range_m, observation.PositionInVehicle().norm());
    }
    const double slack_m = PlaceSlack(state_, range_m);
    state_.Focus(range_m + slack_m);
    TakeNamed(scan, usable.named);
    out_.observations += static_cast<int>(free.size());
    for (const bool confirmed : {true, false}) {
      AssociateWith(confirmed, scan, index, slack_m, &free);
    }
    Begin(scan, index, free);
    DropExpired(index);
    if (index % kDuplicatePeriod == 0) MergeDuplicates();
  }

  AnonymousAssociation Finish(const Run& run) {
    state_.Focus(std::numeric_limits<double>::max());
    MergeDuplicates();
    for (const Scan& scan : run.scans) {
      out_.track_of.emplace_back(scan.observations.size(), -1);
    }
    std::vector<const Track*> kept;
    std::map<const Track*, int> landmark_of;
    for (const auto& [landmark, track] : tracks_) {
      if (!track.confirmed || static_cast<int>(track.seen.size()) < options_.min_sightings) {
        ++out_.dropped_tracks;
        continue;
      }
      kept.push_back(&track);
      landmark_of[&track] = landmark;
    }
    std::stable_sort(kept.begin(), kept.end(), [](const Track* a, const Track* b) {
      return std::pair(a->seen.front().scan, a->seen.front().observation) <
             std::pair(b->seen.front().scan, b->seen.front().observation);
    });
    for (const Track* track : kept) {
      const auto number = static_cast<int>(out_.tracks.size());
      out_.tracks.push_back(state_.Position(landmark_of[track]));
      for (const Sighted& sighted : track->seen) {
        out_.track_of[static_cast<std::size_t>(sighted.scan)]
                     [static_cast<std::size_t>(sighted.observation)] = number;
      }
      out_.associated += static_cast<int>(track->seen.size());
    }
    return std::move(out_);
  }

 private:
  void TakeNamed(const Scan& scan, const std::vector<int>& named) {
    for (const int index : named) {
      const Observation& observation = scan.observations[static_cast<std::size_t>(index)];
      const auto number =
          numbers_.try_emplace(observation.signature, static_cast<int>(numbers_.size()))
              .first->second;
      named_.Observe(number, observation, &state_);
    }
  }

  // Pairs free observations with tracks of one kind, corrects the state by all of them at once.
  void AssociateWith(
      bool confirmed, const Scan& scan, int index, double slack_m, std::vector<int>* free) {
    std::vector<int> landmarks;
    for (const int landmark : state_.active()) {
      const auto track = tracks_.find(landmark);
      if (track != tracks_.end() && track->second.confirmed == confirmed) {
        landmarks.push_back(landmark);
      }
    }
    SlamAssociation found =
        AssociateLandmarks(scan,
                           *free,
                           landmarks,
                           slack_m,
                           options_.joint ? AssociationMethod::kJoint : AssociationMethod::kNearest,
                           options_.compatibility,
                           state_);
    for (std::size_t i = 0; i < found.pairs.size(); ++i) {
      Track& track = tracks_.at(found.pairs[i].landmark);
      track.seen.push_back({index, found.paired[i]});
      track.confirmed |= static_cast<int>(track.seen.size()) >= options_.confirm_sightings;
    }
    state_.Update(found.pairs);
    *free = std::move(found.left);
  }

  bool Isolated(const Observation& observation) const {
    const Eigen::Vector2d p = LandmarkPosition(observation, state_.pose());
    for (const int landmark : state_.active()) {
      if (!tracks_.contains(landmark)) continue;
      if ((state_.Position(landmark) - p).norm() < options_.separation_m) return false;
      Eigen::Matrix2d S;
      const Innovation innovation = state_.Linearized({landmark, &observation}, &S);
      if (SquaredMahalanobis(innovation.nu, S) < isolation_gate_) return false;
    }
    return true;
  }

  void Begin(const Scan& scan, int index, const std::vector<int>& free) {
    for (const int i : free) {
      const Observation& observation = scan.observations[static_cast<std::size_t>(i)];
      if (!Isolated(observation)) continue;
      tracks_[state_.Add(observation)] = {{{index, i}}, false};
    }
  }

  void DropExpired(int now) {
    for (auto track = tracks_.begin(); track != tracks_.end();) {
      const int age = now - track->second.seen.front().scan;
      if (track->second.confirmed || age < options_.confirm_within_scans) {
        ++track;
        continue;
      }
      state_.Remove(track->first);
      track = tracks_.erase(track);
      ++out_.dropped_tracks;
    }
  }

  // Repeated until no two tracks are of one landmark: a merged track moves, and may then be a
  // duplicate of another one.
  void MergeDuplicates() {
    std::vector<int> landmarks;
    for (const int landmark : state_.active()) {
      const auto track = tracks_.find(landmark);
      if (track != tracks_.end() && track->second.confirmed) landmarks.push_back(landmark);
    }
    std::sort(landmarks.begin(), landmarks.end());
    while (FuseOnce(&landmarks)) {
    }
  }

  // Removes each track of `landmarks` that is a duplicate of an earlier one. True if there was any.
  bool FuseOnce(std::vector<int>* landmarks) {
    const std::size_t before = landmarks->size();
    for (std::size_t i = 0; i < landmarks->size(); ++i) {
      for (std::size_t j = i + 1; j < landmarks->size();) {
        if (!AreDuplicates((*landmarks)[i], (*landmarks)[j])) {
          ++j;
          continue;
        }
        Fuse((*landmarks)[i], (*landmarks)[j]);
        landmarks->erase(landmarks->begin() + static_cast<std::ptrdiff_t>(j));
      }
    }
    return landmarks->size() < before;
  }

  bool AreDuplicates(int i, int j) const {
    const Eigen::Vector2d difference = state_.Position(i) - state_.Position(j);
    return difference.norm() <= options_.duplicate_distance_m &&
           SquaredMahalanobis(difference, state_.DifferenceCovariance(i, j)) <= gate_ &&
           !SeenTogether(tracks_.at(i), tracks_.at(j));
  }

  // The older of two tracks of one landmark gets what the other one saw.
  void Fuse(int older, int newer) {
    state_.Fuse(older, newer);
    Track& kept = tracks_.at(older);
    const Track gone = std::move(tracks_.at(newer));
    tracks_.erase(newer);
    const auto middle = static_cast<std::ptrdiff_t>(kept.seen.size());
    kept.seen.insert(kept.seen.end(), gone.seen.begin(), gone.seen.end());
    std::inplace_merge(kept.seen.begin(),
                       kept.seen.begin() + middle,
                       kept.seen.end(),
                       [](const Sighted& a, const Sighted& b) { return a.scan < b.scan; });
  }

  AssociationOptions options_;
  FrontEndOptions front_end_;
  double gate_;
  double isolation_gate_;
  SensorCalibration sensor_;
  SlamState state_;
  GatedLandmarks named_;
  std::map<Signature, int> numbers_;
  std::map<int, Track> tracks_;  // By landmark in the state.
  AnonymousAssociation out_;
};

}  // namespace

Status AssociationOptions::Validate() const {
  const auto probability = [](double value) { return value > 0.0 && value < 1.0; };
  if (!probability(compatibility.gate_probability) || !probability(isolation_probability)) {
    return InvalidArgument("gate_probability and isolation_probability: expected within (0, 1)");
  }
  if (compatibility.max_nodes < 1) {
    return InvalidArgument("max_nodes: {}, expected 1 or more", compatibility.max_nodes);
  }
  if (confirm_sightings < 1 || confirm_within_scans < 1 || min_sightings < 1) {
    return InvalidArgument("confirm_sightings, confirm_within_scans, min_sightings: expected > 0");
  }
  if (!(separation_m >= 0.0) || !(duplicate_distance_m >= 0.0)) {
    return InvalidArgument("separation_m and duplicate_distance_m: expected 0 or more");
  }
  if (!(min_associated_share >= 0.0 && min_associated_share <= 1.0)) {
    return InvalidArgument("min_associated_share: expected within [0, 1]");
  }
  return OkStatus();
}

AnonymousAssociation AssociateAnonymous(const Run& run,
                                        const Calibration& calibration,
                                        const AssociationOptions& options,
                                        const FrontEndOptions& front_end,
                                        const std::function<bool()>& on_step) {
  Tracker tracker(calibration, options, front_end);
  std::vector<StampedPose> trajectory;
  std::size_t hint = 0;
  for (std::size_t i = 0; i < run.scans.size(); ++i) {
    if (on_step && i % kDuplicatePeriod == 0 && !on_step()) break;
    const Scan& scan = run.scans[i];
    if (i > 0) {
      tracker.Predict(IntegrateMotion(
          run.odometry, run.scans[i - 1].stamp, scan.stamp, tracker.Odometry(), &hint));
    }
    tracker.Take(scan, static_cast<int>(i));
    trajectory.push_back({scan.stamp, tracker.pose()});
  }
  AnonymousAssociation result = tracker.Finish(run);
  result.trajectory = std::move(trajectory);
  return result;
}

}  // namespace shiftmap
