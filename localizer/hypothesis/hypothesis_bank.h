// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "localizer/hypothesis/body_prior.h"
#include "localizer/hypothesis/hypothesis_tree.h"
#include "localizer/hypothesis/known_map_leaf.h"
#include "localizer/hypothesis/unseen_way.h"
#include "localizer/models/field_of_view.h"
#include "localizer/models/mode_grid.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/run/run.h"

namespace shiftmap {

struct HypothesisOptions {
  /// Accepted probability of a wrong decision, in (0, 0.5). Larger decides earlier. [-]
  double alpha = 1e-4;
  /// Leaves kept at most, >= 1. More cost time in proportion, where there is as much doubt, and
  /// drop less probability. [-]
  int max_leaves = 48;
  /// An observation gates with a mode if its innovation is inside this share of its distribution,
  /// in (0, 1): for ObservationOutcome. What leaves make of it is weighed, not gated. [-]
  double gate_probability = 0.999;
  FieldOfViewOptions field_of_view;
  /// P_FOV above which a group enters the field of view, γ1 of T-IV VIII-A. [-]
  double fov_enter = 0.5;
  /// P_FOV below which it leaves, γ2 < γ1. [-]
  double fov_leave = 0.1;
  /// A visit ends when its group was out of view and unseen for this long, > 0. [s]
  double visit_gap_s = 5.0;
};

/// What became of one observation of a known signature in the heaviest leaf.
struct ObservationOutcome {
  std::size_t index = 0;   ///< Into Scan::observations.
  int group = 0;           ///< Index into MapSnapshot::groups().
  bool gated = false;      ///< With a mode that the leaf holds possible.
  bool gated_any = false;  ///< With any mode of the group.
  int state = 0;           ///< Of the mode it gated with, the likeliest one; 0: with none.
  Eigen::Vector2d nu = Eigen::Vector2d::Zero();  ///< Observed - expected, vehicle frame. [m]
  Eigen::Matrix2d S = Eigen::Matrix2d::Zero();   ///< Of nu. [m²]
  double nis = 0.0;                              ///< νᵀ S⁻¹ ν, 2 dof.
};

/// What a scan led to, beside the leaves themselves.
struct BankEvents {
  std::vector<ObservationOutcome> outcomes;
  std::vector<VisitEvidence> evidence;  ///< Of visits that ended.
  std::vector<TreeDecision> decisions;

  void Clear();
};

/// The hypotheses about where the vehicle is and which mode of every group holds, Algorithm 1 of
/// T-IV on a known map.
///
/// A leaf forks only when an observation tells modes apart (Rao-Blackwellized: unresolved groups
/// share the leaf's filter). Cost per scan: leaves × groups near the vehicle, whatever the size of
/// the map. Equations and the life of a visit: localizer/METHOD.md.
///
/// Memory: leaves, visits and what a scan leads to reuse what they had; after the first scans only
/// the records of visits and decisions allocate, and a visit of a group with more states than
/// kInlineStates.
/// Threads: none. Determinism: the same calls give the same bits.
class HypothesisBank {
 public:
  /// @param start    Pose at `stamp`.
  HypothesisBank(MapSnapshot snapshot,
                 const HypothesisOptions& options,
                 const PoseWithCovariance& start,
                 Stamp stamp);

  /// Starts again at another pose: leaves and open visits go, what visits said that ended before
  /// `wrong_since` stays.
  void Restart(const PoseWithCovariance& start, Stamp stamp, Stamp wrong_since = Stamp::max());

  /// Adds a leaf at another pose, as heavy as all others together, with the map's probabilities of
  /// all modes. Returns false, and does nothing, if a leaf stands for it already.
  bool Consider(const PoseWithCovariance& pose);

  /// Moves all leaves on.
  void Predict(const MotionIncrement& increment, double elapsed_s);

  /// Takes a scan in. Observations of signatures that the map does not know are skipped.
  /// @param scan   At the time that the leaves were moved to; every signature at most once.
  /// @param lidar  At that time, for the field of view; null: none.
  /// @return  Valid until the next call.
  const BankEvents& Correct(const Scan& scan, const LidarView* lidar = nullptr);

  /// Ends all visits, as at the end of a shift.
  std::vector<VisitEvidence> EndVisits();

  const Leaf& best() const { return tree_.best(); }

  /// The pose of the heaviest leaf, with the second moment of the poses of all leaves about it.
  PoseWithCovariance Pose() const;

  /// Standard deviation of the heaviest leaf's position in its most uncertain direction, against
  /// the landmark around it of which that is smallest: errors that pose and map share, as the
  /// map's scale, are not in it. Without a landmark around, with them. [m]
  double SdAmongLandmarks() const;

  /// Probability that the vehicle is nearer to `there` than to `here`. [m]
  double ShareNearer(const Eigen::Vector2d& there, const Eigen::Vector2d& here) const;

  /// Where dead reckoning has the vehicle: it moves as the vehicle does, and is never corrected.
  const Se2& T_odom_vehicle() const { return T_odom_vehicle_; }
  const LeafSet<Leaf>& leaves() const { return tree_.leaves(); }

  /// At the last scan.
  const FieldOfView& field_of_view() const { return view_; }
  const std::vector<Visit>& visits() const { return tree_.visits(); }

  /// Probability of each state of a group now; size n + 1, never exactly 0 or 1.
  Eigen::VectorXd Probabilities(int group) const {
    return tree_.Probabilities(group, snapshot_.groups(), stamp_);
  }

  /// Largest probability mass that the bound on the leaves cost in one scan.
  double dropped_mass_max() const { return tree_.dropped_mass_max(); }
  int leaves_max() const { return tree_.leaves_max(); }

 private:
  // An observation of a landmark that stands at none of its modes.
  struct AtNoMode {
    double log_density = 0.0;  // In its own units.
    double place_share = 0.0;  // Of it that is not a false alarm.
  };

  // Landmarks that confirm a pose.
  static constexpr int kConfirming = 2;

  // An observation against a mode of a leaf.
  struct ModeScore {
    KnownMapFilter::Prediction prediction;
    double log_detection = 0.0;              // log P_D; what is seen is in view, T-IV VI-D.
    double log_miss = 0.0;                   // log(1 - P_D).
    std::optional<double> log_likelihood{};  // log P_D + log p(z | observations before).
  };
  struct SeenObservation;  // What all leaves have in common about an observation.

  double Occluded() const { return snapshot_.calibration().sensor.occluded_visit_probability; }
  const LandmarkGroup& GroupAt(int group) const {
    return snapshot_.groups()[static_cast<std::size_t>(group)];
  }
  bool FarOutsideSector(const Mode& mode) const;
  bool InView(int group, double threshold) const;
  InViewProbability InView(const KnownMapFilter::Point& point) const {
    return view_.Probability(point.q, point.cov_q);
  }
  double LogDetection(double in_view) const;
  ModeScore Score(const Leaf& leaf, const SeenObservation& seen, int state) const;
  double LogLikelihood(const Leaf& leaf, ModeRef mode, ModeScore* score) const;
  // Log-likelihoods of what an observation is taken for; the leaf or its belief gets what that says
  // of the landmark.
  double TakeAsUngated(const Leaf& leaf,
                       const SeenObservation& seen,
                       const ModeScore& score,
                       int state,
                       PlaceBelief* belief) const;

  double TakeAsAbsent(const SeenObservation& seen,
                      double weight,
                      Leaf* leaf,
                      PlaceBelief* belief) const;
  double TakeAsSameView(const SeenObservation& seen, double log_ungated, Leaf* leaf) const;
  double LogAtPlace(const KnownMapFilter::Prediction& prediction,
                    const UnknownPlace& place,
                    const Leaf& leaf) const;
  AtNoMode ScoreAtNoMode(const SeenObservation& seen,
                         const Leaf& leaf,
                         const PlaceBelief& belief) const;
  MovedLandmarks MovedIn(const Leaf& leaf) const;
  void StartPlace(const SeenObservation& seen,
                  double probability,
                  Leaf* leaf,
                  PlaceBelief* belief) const;
  // Apart from the modes of a group.
  bool IsUnknown(int group, const Eigen::Vector2d& p_map_landmark) const;
  bool IsSeenFromApart(const UnknownPlace& place) const {
    return (T_odom_vehicle_.translation() - place.p_odom_viewpoint).norm() > kApart;
  }
  void MissPlace(const Leaf& leaf, PlaceBelief* belief) const;

  // A bound on TakeAsUngated() that costs less.
  static double LogUngatedAtMost(const SeenObservation& seen, const ModeScore& score);

  void OpenVisitsInView(const Scan& scan);
  void Take(const Observation& observation, std::size_t index, int group);
  ObservationOutcome Judge(const SeenObservation& seen);
  // Takes in whether an observation agrees with the pose, and whether it doubts the map or that.
  void JudgePose(const ObservationOutcome& outcome, Visit* visit);
  void ConfirmPose();
  bool IsFarFromConfirmed() const;
  // Each leaf goes on as two after a way without sightings: in one of them the wheels have slipped.
  // And again at a landmark that has agreed since, alone: it has not moved when it fails.
  void AllowForSlip(int group);
  bool HasAgreedSince(int group, Stamp since) const;
  int CountAgreeing(Stamp since, int except) const;
  // Whether others have agreed with the pose since a visit contradicts the map.
  bool IsConfirmed(const Visit& visit) const;
  double ViewWeight(Visit* visit) const;
  void Observe(const SeenObservation& seen, double weight);
  void Branch(const SeenObservation& seen, double weight, bool heaviest, Leaf* leaf);
  void AddChild(const Leaf& parent,
                const SeenObservation& seen,
                const ModeScore& score,
                const PlaceBelief& before,
                int state,
                double weight);
  void Resolve(const SeenObservation& seen,
               const ModeScore& score,
               int state,
               double weight,
               Leaf* leaf) const;
  void Miss(int group);

  MapSnapshot snapshot_;
  HypothesisOptions options_;
  FieldOfView view_;
  ModeGrid grid_;
  double gate_ = 0.0;                   // Chi-square quantile.
  double unknown_place_density_ = 0.0;  // UnknownPlaceDensity().
  Eigen::Vector2d edge_of_view_;        // Of the sector, on the left; a unit vector.
  Stamp stamp_;
  Se2 T_odom_vehicle_;  // Dead-reckoned, the same for all leaves.
  HypothesisTree<Leaf> tree_;
  BankEvents events_;
  std::vector<int> nearby_;                       // Scratch.
  std::vector<std::optional<ModeScore>> judged_;  // Of the heaviest leaf, by state.
  // Landmarks that agreed with the pose last, the latest first.
  struct Agreement {
    int group = -1;
    Stamp stamp = Stamp::min();
  };
  std::array<Agreement, kConfirming + 1> agreed_;
  Se2 T_odom_confirmed_;                    // Dead-reckoned, where the pose was confirmed last.
  std::optional<Stamp> slip_allowed_;       // Last; nothing: not since then.
  UnseenWay unseen_way_;                    // Since then, or since a slip was allowed last.
  std::optional<Stamp> unconfirmed_since_;  // First observation too far from there.
  double heaviest_fork_ = 0.0;  // Log-weight, of those that the present observation made.
};

}  // namespace shiftmap
