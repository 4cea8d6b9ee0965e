// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/geometry/covariance.h"
#include "tools/experiment/tiv_approximations_world.h"

namespace shiftmap {

/// A mode as a hypothesis has it.
struct HypothesisMode {
  int group = 0;
  int state = 0;
  Eigen::Vector2d place = Eigen::Vector2d::Zero();  ///< Map frame. [m]
  Eigen::Matrix2d cov = Eigen::Matrix2d::Zero();    ///< [m²]
  bool active = false;                              ///< By its mode vector.
};

/// A hypothesis about the first landmark: its probability, and the likeliest leaf with it.
struct HypothesisView {
  double probability = 0.0;
  PoseWithCovariance pose;
  std::vector<HypothesisMode> modes;  ///< Those that the leaf has found.
};

/// What is thought after a scan: A, the landmark stands where the map has it; B, it stands at the
/// first place where it was seen and gated with no mode. Nothing: no leaf has it any more, or yet.
struct HypothesisPair {
  std::optional<HypothesisView> a;
  std::optional<HypothesisView> b;

  double ProbabilityOfA() const { return a ? a->probability : 0.0; }
  double ProbabilityOfB() const { return b ? b->probability : 0.0; }
};

/// T-IV figure 3: a vehicle with an uncertain pose drives past L00, which has left m_1^1 for a
/// place that the map does not have, and later past L01, whose active mode m_2^2 is right.
struct TivFigureScene {
  ApproximationsDrive drive;
  int first_seen = 0;   ///< Scan that saw L00 first.
  int second_seen = 0;  ///< Scan that saw L01 first.
};
TivFigureScene MakeTivFigureScene();

/// By scan. @param update_ungated  As in TreeSlamOptions; the rest as it is by default.
std::vector<HypothesisPair> FollowTivFigure(const TivFigureScene& scene, bool update_ungated);

/// The scans that the panels show.
struct TivFigureMoments {
  int adapted = 0;   ///< (b): the last before L01 is seen.
  int selected = 0;  ///< (c): from here on B is likelier than A.
  /// (d): from here on B is a hundred times as likely as A, if only what gates corrects.
  int rejected = 0;
};
TivFigureMoments FindTivFigureMoments(const TivFigureScene& scene,
                                      const std::vector<HypothesisPair>& ungated,
                                      const std::vector<HypothesisPair>& gated);

/// The four panels as an SVG document.
std::string DrawTivFigure(const TivFigureScene& scene,
                          const std::vector<HypothesisPair>& ungated,
                          const std::vector<HypothesisPair>& gated);

}  // namespace shiftmap
