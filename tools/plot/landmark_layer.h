// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "mapstore/map/landmark_group.h"
#include "mapstore/map/main_mode.h"
#include "mapstore/map/map_snapshot.h"
#include "tools/plot/label_placer.h"
#include "tools/plot/legend.h"
#include "tools/plot/map_frame.h"
#include "tools/plot/svg.h"

namespace shiftmap {

/// The state that is the most probable: 0 is `absent`.
Eigen::Index MostProbable(const LandmarkGroup& group);

/// Whether a picture shows the landmark as absent: that is more than 60 % probable.
bool IsLikelyAbsent(const LandmarkGroup& group);

/// A probability in per cent: `97 %`, `< 1 %`, `> 99 %`.
std::string PercentText(double probability);

/// The landmarks of a map and the frame that has room for them.
///
/// Every mode is a dot whose opacity is its probability, in its 95 % ellipse, which is that of a
/// FreeNetwork. Where ellipses would be too small to see, all are magnified by one round factor,
/// which the legend states. Beyond
/// kManyModes, dots shrink and neither ellipses nor labels are drawn: time and size of the picture
/// are then bounded by some tens of bytes per mode.
class LandmarkLayer {
 public:
  static constexpr std::size_t kManyModes = 1500;
  static constexpr double kRadius = 4.0;  ///< Of a dot on a map of few modes. [px]

  /// @param others  Points that the frame must have room for too. Map frame. [m]
  LandmarkLayer(const MapContent& content, std::vector<Eigen::Vector2d> others);

  const MapFrame& frame() const { return frame_; }
  double radius() const { return radius_; }
  bool many() const { return many_; }

  /// @param fade  Opacity of everything, for landmarks in the background.
  void Draw(double fade, Svg* svg) const;

  /// Signature, number and probability of the main mode of every landmark that has room for it;
  /// number and probability of the others.
  /// @param placer  Of MakePlacer(), and what else labels are to keep clear of.
  void DrawLabels(LabelPlacer placer, Svg* svg) const;

  /// A placer within the frame that keeps clear of all modes.
  LabelPlacer MakePlacer() const;

  void AddTo(Legend* legend) const;

  /// The 95 % ellipse as drawn. [px]
  void DrawEllipse(const Mode& mode, const SvgStyle& style, Svg* svg) const;

 private:
  void ChooseMagnification();
  void DrawGroup(const LandmarkGroup& group, double fade, Svg* svg) const;
  void DrawMany(double fade, Svg* svg) const;
  void DrawAnonymous(double fade, Svg* svg) const;
  bool Label(const LandmarkGroup& group, std::size_t mode, LabelPlacer* placer, Svg* svg) const;

  MapContent content_;
  bool free_ = false;      // Its ellipses are those of a free network,
  double scale_sd_ = 0.0;  // without an error of scale.
  MapFrame frame_;
  double radius_ = kRadius;     // Of a dot. [px]
  double magnification_ = 1.0;  // Of the ellipses.
  bool many_ = false;
};

}  // namespace shiftmap
