// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>
#include <unordered_map>
#include <vector>

#include "localizer/hypothesis/hypothesis_tree.h"
#include "mapper/calibration/detection.h"
#include "mapper/tree/slam_leaf.h"
#include "mapper/tree/tree_options.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// What a scan led to, beside the leaves themselves.
struct TreeEvents {
  std::vector<VisitEvidence> evidence;  ///< Of visits that ended.
  std::vector<TreeDecision> decisions;

  // Observations with a signature, in the likeliest leaf.
  double nis_sum = 0.0;  ///< νᵀ S⁻¹ ν of those that corrected it.
  int ungated = 0;       ///< Those that gate with no mode of their landmark.
};

/// Multi-hypothesis SLAM, T-IV Algorithm 1 with EKF-SLAM (27)-(29) in every leaf: the pose, the
/// positions of all modes and of landmarks without signature, and which mode of each group holds.
///
/// A leaf forks when an observation gates with one of the modes that it holds possible; what cannot
/// be told apart shares its filter, T-IV VI-A. What gates with no mode of its group is clutter, or
/// stands at a place that becomes a mode of the group. Method and what differs from the print:
/// mapper/METHOD.md, 13.
///
/// Frame: that of the prior map, or that of the first start pose.
/// Cost of a scan: leaves × (landmarks around the vehicle)². Threads: none. Determinism: the same
/// calls give the same bits.
class TreeSlam {
 public:
  /// @param prior  Modes and their covariance, their probabilities at its stamp, and landmarks
  ///               without signature; what is known before. Empty: nothing.
  /// Precondition: the options are valid, the prior by ValidateMapContent().
  TreeSlam(const TreeSlamOptions& options,
           const Calibration& calibration,
           const std::optional<MapContent>& prior);

  enum class Direction { kForward, kBackward };

  /// A run begins at a pose that is independent of the map's errors.
  /// @param calibration  Of the run's odometry and of its sensor's noise.
  /// @param direction    Backward: scans come in the opposite order of time, motions are inverse. A
  ///                     run that is found on the map somewhere is filtered both ways from there.
  void BeginRun(const PoseWithCovariance& start,
                const Calibration& calibration,
                Stamp stamp,
                Direction direction = Direction::kForward);

  /// The same for a pose that was found among landmarks of the map: its covariance is that relative
  /// to those in reach, and where they are off together the pose is off as they are. Else every run
  /// would tell anew, and wrongly, where the far end of a map is.
  void BeginRunOnMap(const PoseWithCovariance& start,
                     const Calibration& calibration,
                     Stamp stamp,
                     Direction direction = Direction::kForward);

  /// Time update of all leaves.
  void Predict(const MotionIncrement& motion);

  /// The same by T-IV (28): an Euler step, with noise of the pose in the map frame.
  /// @param Q  Of (x, y, yaw), per step. [m, m, rad]
  void PredictEuler(double v_mps, double omega_radps, double seconds, const Eigen::Matrix3d& Q);

  /// Branching, scores, pruning and measurement update. Observations of one signature at two places
  /// are left out. Returns what is valid until the next call.
  /// @param lidar  What occludes landmarks at the time of the scan; null: nothing known does.
  const TreeEvents& Correct(const Scan& scan, const LidarView* lidar = nullptr);

  /// Ends all visits. Landmarks whose mode is open stay so.
  std::vector<VisitEvidence> EndRun();

  const LeafSet<SlamLeaf>& leaves() const { return tree_.leaves(); }
  const std::vector<Visit>& visits() const { return tree_.visits(); }
  const SlamLeaf& best() const { return tree_.best(); }

  /// Takes landmarks without signature out of the map, by where each leaf has them.
  void ForgetAnonymous(const std::function<bool(const Eigen::Vector2d&)>& is_forgotten);

  /// Scales of odometry as the likeliest leaf estimates them so far.
  OdometryCalibration Odometry() const { return best().filter.state().Odometry(); }

  /// By ascending age; positions and covariances are those of Content().
  const std::vector<LandmarkGroup>& groups() const { return groups_; }

  /// Probability of each state of a group now.
  Eigen::VectorXd Probabilities(int group) const {
    return tree_.Probabilities(group, groups_, now_);
  }

  /// The map of the likeliest leaf, covariances as the filter has them: of a map without a prior,
  /// relative to the first pose. Groups without modes and unconfirmed landmarks are left out.
  /// Precondition: no visit is open.
  MapContent Content();

  /// Landmarks in view whose mode the likeliest leaf knew, and how many of them were seen, in scans
  /// that saw another one too.
  const DetectionCount& detections() const { return detections_; }

  double dropped_mass_max() const { return tree_.dropped_mass_max(); }
  int leaves_max() const { return tree_.leaves_max(); }
  int modes_merged() const { return modes_merged_; }

 private:
  // An observation against a mode of a leaf.
  struct Score {
    double nis = 0.0;
    double log_likelihood = 0.0;  // log P_D + log N(ν; 0, S).
    double log_miss = 0.0;        // log(1 - P_D).
  };
  // An observation with what all leaves have in common about it.
  struct Seen {
    const Observation* observation = nullptr;
    int group = 0;
    std::size_t belief = 0;        // Into Leaf::beliefs.
    int new_state = 0;             // Of the mode that it makes where it gates with none.
    double log_false_alarm = 0.0;  // β_FA, in the observation's own units.
    double log_new = 0.0;          // β_NT.
  };

  int GroupOf(const Signature& signature);
  void AddPrior(const MapContent& prior, SlamMap* map);
  void AddAnonymous(const std::vector<Mode>& landmarks, SlamMap* map) const;
  double InView(const SlamState::Relative& relative) const;
  double InView(const SlamMap& map, int landmark) const;
  bool AnyInView(int group, double threshold) const;

  VisitEvidence CloseVisit(std::size_t visit_index);
  void OpenVisitsInView();
  void Take(const Observation& observation);
  void CountOutcome(const Seen& seen);
  void CountDetections(int seen);
  void CountContradictions(const Seen& seen);
  bool CanFindMode(const GroupBelief& belief) const;
  bool GatesNowhere(const SlamLeaf& leaf, const Seen& seen) const;
  double NisOf(const SlamLeaf& leaf, const Seen& seen, int state) const;
  Score ScoreMode(const SlamLeaf& leaf, const Seen& seen, int state) const;
  void Branch(const Seen& seen, SlamLeaf* leaf);
  void BranchUnresolved(const Seen& seen, SlamLeaf* leaf);
  void BranchResolved(const Seen& seen, SlamLeaf* leaf);
  void AddChild(const SlamLeaf& parent,
                const GroupBelief& before,
                const Seen& seen,
                int state,
                double log_likelihood);
  static void Resolve(const Seen& seen, int state, double log_weight, SlamLeaf* leaf);
  bool UpdatesBy(const Score& score) const;
  void FindMode(const Seen& seen, double log_prior, SlamLeaf* leaf) const;
  void Miss(int group);

  void SetChain(int group);
  int AddMode(int group);
  void ReviseNewModes(int group);
  void ShareModes(int group);
  void MergeMode(int group, int state, int into);
  int DuplicateOf(int group, int state);

  TreeSlamOptions options_;
  SensorCalibration sensor_;
  FieldOfView view_;
  double gate_;
  HypothesisTree<SlamLeaf> tree_;
  std::vector<LandmarkGroup> groups_;
  std::unordered_map<Signature, int> index_;
  std::vector<ModeChain> chains_;     // By group: of the modes that it had at first.
  std::vector<int> confirmed_modes_;  // By group: those from here on are new since the last visit.
  Stamp stamp_;                       // Of the present scan.
  Stamp now_;    // The time that visits and chains go by: later with every scan.
  Stamp begin_;  // Of the run.
  bool backward_ = false;
  int scan_ = 0;
  TreeEvents events_;
  DetectionCount detections_;
  int modes_merged_ = 0;
};

}  // namespace shiftmap
