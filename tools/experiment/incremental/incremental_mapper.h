// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "localizer/models/motion_model.h"
#include "mapper/selection/selector.h"
#include "mapstore/core/stamp.h"
#include "mapstore/run/run.h"
#include "proto/core/status.h"
#include "tools/experiment/incremental/fixed_lag_smoother.h"
#include "tools/experiment/incremental/incremental_options.h"
#include "tools/experiment/incremental/mode_window.h"

namespace shiftmap {

/// The map that a run starts from: a joint Gaussian of modes.
struct IncrementalPrior {
  int groups = 0;          ///< Landmarks, also those of which no mode is known.
  std::vector<int> group;  ///< Per mode the landmark that it is of.
  Eigen::VectorXd mean;    ///< Stacked (x, y) of the modes. [m]
  Eigen::MatrixXd cov;     ///< Joint covariance, the same order. [m²]

  /// Per landmark which of its modes held before the run, or kNoMode. Empty: the only one of those
  /// that have one, and of others none is known.
  std::vector<int> choice_before;
};

/// One landmark as a scan saw it.
struct GroupObservation {
  int group = 0;
  Observation observation;
};

/// One key frame: how the vehicle came there, and what it sees.
struct IncrementalFrame {
  Stamp stamp;
  MotionIncrement motion;  ///< From the frame before; of the first one without effect.
  std::vector<GroupObservation> observations;  ///< At most one of a group.
};

/// What a step did.
struct IncrementalStep {
  int modes_created = 0;
  int modes_merged = 0;
  int alternations = 0;          ///< Of selecting and solving.
  bool fully_optimized = false;  ///< The alternation did not settle.
};

/// Maps one run frame by frame, IJRR 5 to 7. In a step
///
/// 1. the pose is predicted by odometry;
/// 2. every observation is gated with the joint marginal of pose and mode, IJRR (30); what is
///    beyond the gate of every mode of its landmark makes a mode, once enough of it agrees; what is
///    within starts at the most likely, by the innovation and, for selectors that know the chain,
///    by which mode held last: the wrong one would draw the pose along and confirm itself;
/// 3. the modes of the landmarks that were seen are selected over the window and all that is
///    continuous is solved, in turn until no choice changes; where they do not settle in
///    `max_alternations` or come around in a cycle, a full optimization ends it (IJRR 8.2.2);
/// 4. modes of a landmark that are one place are merged;
/// 5. frames older than the window are dropped into what they say of the rest.
///
/// The max-mixture selects after every step of the solver instead. Determinism: the same input and
/// options give the same bits.
class IncrementalMapper {
 public:
  /// @param start  Of the first frame, in the frame of the prior map.
  /// Errors: kInvalidArgument for options out of range, and for a prior whose sizes do not fit
  /// together or whose covariance is not positive definite.
  static StatusOr<IncrementalMapper> Create(const IncrementalOptions& options,
                                            const IncrementalPrior& prior,
                                            const PoseWithCovariance& start);

  /// Precondition: stamps do not go backwards, groups are those of the prior.
  /// Errors: kInvalidArgument if values that are not finite leave nothing determined.
  StatusOr<IncrementalStep> AddFrame(const IncrementalFrame& frame);

  /// Selects the modes of all landmarks over the window once more and optimizes it fully.
  /// Precondition: there was a frame. Errors: as AddFrame().
  Status Finish();

  /// T_map_vehicle at the newest frame. Precondition: there was one.
  const Se2& T_map_vehicle() const { return smoother_.newest().T_map_vehicle; }

  /// T_map_vehicle at every frame; those before the window as they were when they left it.
  std::vector<Se2> Trajectory() const;

  /// Positions of all modes of a landmark, those of the map first. [m]
  std::vector<Eigen::Vector2d> Modes(int group) const;

  /// Per observation, in the order in which they came, the mode of its landmark that it is of, an
  /// index of Modes(), or kNoMode.
  std::vector<int> Choices() const;

  const Window& window() const { return smoother_.window(); }

 private:
  IncrementalMapper(const IncrementalOptions& options, const PoseWithCovariance& start);

  void AddPrior(const IncrementalPrior& prior, const Eigen::MatrixXd& sqrt_information);
  Status Undetermined() const;
  void Predict(const IncrementalFrame& frame);
  int LatestMode(int group) const;
  int Associate(const GroupObservation& seen, const Eigen::Matrix2d& cov_z) const;
  Eigen::Matrix2d SightingCovariance(const Observation& seen, const Eigen::Matrix2d& cov_z) const;
  int TryCreateMode(int group);
  bool SelectModes(int group);
  StatusOr<IncrementalStep> Alternate(const std::vector<int>& groups);
  int MergeModes(int group);
  void Retire();

  IncrementalOptions options_;
  std::unique_ptr<Selector> selector_;
  FixedLagSmoother smoother_;
  std::vector<IncrementalGroup> groups_;
  std::vector<Stamp> stamps_;       // Of the frames in the window.
  std::vector<Se2> retired_poses_;  // Of those before it.
  std::vector<int> choices_;        // Per observation, a mode of the smoother.
};

}  // namespace shiftmap
