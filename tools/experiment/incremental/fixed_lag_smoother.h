// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <vector>

#include "localizer/models/motion_model.h"
#include "mapper/graph/graph.h"
#include "mapstore/geometry/covariance.h"
#include "tools/experiment/incremental/frame_chunk.h"
#include "tools/experiment/incremental/window.h"

namespace shiftmap {

struct SmootherOptions {
  /// Prior of the calibration. Standard deviations of 1e-9 hold it.
  CalibrationVector calibration_mean = CalibrationVector::Zero();
  CalibrationVector calibration_sd = CalibrationVector::Constant(1e-9);

  /// Cauchy loss of observations, in standard deviations; see Graph::loss_scale.
  double loss_scale = 2.5;

  /// What moved less than this since it was linearized stays linearized where it was. Raising it
  /// makes steps cheaper and less exact: the error is of second order in it. [m], [rad]
  double relinearize_threshold = 2e-3;

  /// Gauss-Newton steps of one Solve() at most.
  int max_iterations = 10;
};

/// The continuous part of IJRR (21) as frames come in: poses of the last frames, every mode's
/// position and the calibration, by least squares; observations are switched to modes from outside.
///
/// Frames are eliminated in chunks in the order of time (frame_chunk.h), so that what is left is a
/// small system over the newest pose, the calibration and the modes, of which the joint marginals
/// come for free. What a step changes is eliminated anew from there on, as in iSAM (Kaess et al.
/// 2008), and everything before stays.
///
/// DropBefore() turns frames into what their chunks carry, a Gaussian over the oldest pose kept,
/// the calibration and the modes: the exact Schur complement at the values that these had then.
/// Their Jacobians are taken at those values from then on (first estimates), and residuals at the
/// present ones. Otherwise different factors would see different null spaces, and the map frame
/// would seem to be known without anything that tells it. The price is a bias of second order where
/// a first estimate was bad.
class FixedLagSmoother {
 public:
  FixedLagSmoother(const SmootherOptions& options, const PoseWithCovariance& start);

  /// Adds a mode and returns its number, from 0 on.
  /// @param cov  Of its position, while no observation is switched to it. [m²]
  int AddMode(const Eigen::Vector2d& p_map_landmark, const Eigen::Matrix2d& cov);

  /// What is known of modes beforehand; they have to be there.
  void SetPrior(const GraphPrior& prior);

  /// Adds a frame, the first at the start pose, others behind a motion from the one before.
  void AddFrame();
  void AddFrame(const MotionIncrement& motion);

  /// Adds an observation from the newest frame. Its `number` says which one it is.
  void AddObservation(WindowObservation observation);

  /// Switches an observation to another mode or to kNoMode.
  /// @param frame, observation  Indices in the window.
  void Switch(int frame, int observation, int mode);

  /// `from` and `to` are one mode: all that is known of the first holds for the second.
  void MergeModes(int from, int to);

  /// Solves for everything in the window, at most `max_iterations` steps of those of the options,
  /// and relinearizes what moved. False if something is not determined; estimates stay then.
  bool Solve() { return Solve(options_.max_iterations); }
  bool Solve(int max_iterations);

  /// Linearizes the whole window at every step until it stands still.
  bool SolveFully();

  /// Drops frames before one, as far as whole chunks go; indices in the window change. Returns
  /// those that went.
  std::vector<WindowFrame> DropBefore(int frame);

  const Window& window() const { return window_; }
  const WindowFrame& newest() const { return window_.frames.back(); }

  /// Covariance of ξ of the newest pose at the last Solve(). [m, m, rad]
  Eigen::Matrix3d PoseCovariance() const;

  /// Joint covariance of (ξ of the newest pose, p of a mode) at the last Solve(). [m, m, rad, m, m]
  Eigen::Matrix<double, 5, 5> PoseModeCovariance(int mode) const;

  /// Joint covariance of two modes at the last Solve(). [m²]
  Eigen::Matrix4d ModePairCovariance(int a, int b) const;

 private:
  struct Staleness {
    int first_chunk = 0;  // The first to eliminate anew; the number of chunks if none.
    bool settled = true;  // Nothing that may be linearized anew has moved too far.
  };

  int ChunkOf(int frame) const;
  bool SolveOnce();
  bool AssembleNewest(CarriedSystem* system) const;
  void AddPriors(CarriedSystem* system) const;
  void MoveOrigins(int chunk);
  const CarriedSystem& CarriedTo(int chunk) const;
  Staleness FindStale() const;
  Eigen::MatrixXd Covariance(const std::vector<Eigen::Index>& columns) const;

  SmootherOptions options_;
  GraphPrior prior_;
  Window window_;
  CarriedSystem dropped_;  // Carried to the first frame of the window.
  std::vector<FrameChunk> chunks_;
  int stale_ = 0;                                          // The first chunk to eliminate anew.
  Eigen::LLT<Eigen::MatrixXd> newest_{Eigen::MatrixXd()};  // Empty: copied before it is computed.
};

}  // namespace shiftmap
