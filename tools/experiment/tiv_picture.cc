// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/tiv_picture.h"

#include <algorithm>
#include <numbers>

#include "tools/plot/confidence_ellipse.h"
#include "tools/plot/svg.h"

namespace shiftmap {
namespace {

constexpr double kScale = 8.0;    // [px/m]
constexpr double kMargin = 30.0;  // [px]
constexpr double kLegend = 110.0;

// Colours that can be told apart with any colour vision (Okabe, Ito).
constexpr const char* kOriginal = "#b0b0b0";
constexpr const char* kModified = "#d55e00";
constexpr const char* kMulti = "#000000";
constexpr const char* kStatic = "#009e73";
constexpr const char* kTruth = "#56b4e9";
constexpr const char* kAnonymous = "#0072b2";
constexpr const char* kMode = "#cc79a7";

// The mine lies on its side: the drift from left to right.
class Frame {
 public:
  explicit Frame(const std::vector<Wall>& walls) {
    for (const Wall& wall : walls) {
      for (const Eigen::Vector2d& p : {wall.a, wall.b}) {
        low_ = low_.cwiseMin(p);
        high_ = high_.cwiseMax(p);
      }
    }
  }

  Eigen::Vector2d operator()(const Eigen::Vector2d& p) const {
    return {kMargin + kScale * (p.y() - low_.y()), kMargin + kScale * (p.x() - low_.x())};
  }
  Eigen::Vector2d Size() const {
    const Eigen::Vector2d size = high_ - low_;
    return {2.0 * kMargin + kScale * size.y(), 2.0 * kMargin + kScale * size.x() + kLegend};
  }

 private:
  Eigen::Vector2d low_ = Eigen::Vector2d::Constant(1e9);
  Eigen::Vector2d high_ = Eigen::Vector2d::Constant(-1e9);
};

void DrawPath(const std::vector<Se2>& poses, const Frame& frame, const SvgStyle& style, Svg* svg) {
  std::vector<Eigen::Vector2d> points;
  for (const Se2& pose : poses) points.push_back(frame(pose.translation()));
  svg->Polyline(points, style);
}

void DrawLandmark(const Mode& mode, const Frame& frame, const SvgStyle& style, Svg* svg) {
  const ConfidenceEllipse ellipse = MakeEllipse(mode.cov_p_map_landmark);
  const Eigen::Vector2d half_axes = (kScale * ellipse.half_axes).cwiseMax(1.5);
  const Eigen::Vector2d at = frame(mode.p_map_landmark);
  // x of the map is down, y to the right.
  svg->Ellipse(at, half_axes, 0.5 * std::numbers::pi - ellipse.rotation_rad, style);
  svg->Circle(at, 1.5, {.fill = style.stroke});
}

void DrawLegend(double top, Svg* svg) {
  struct Entry {
    const char* text;
    SvgStyle style;
  };
  const Entry entries[] = {
      {"walls, mapped", {.stroke = kOriginal, .stroke_width = 2.5}},
      {"walls, now", {.stroke = kModified, .stroke_width = 1.0}},
      {"truth", {.stroke = kTruth, .stroke_width = 3.0}},
      {"multi-hypothesis", {.stroke = kMulti, .stroke_width = 1.2}},
      {"static SLAM", {.stroke = kStatic, .stroke_width = 1.2}},
      {"landmark without signature, 95 %", {.stroke = kAnonymous}},
      {"mode that holds, 95 %", {.stroke = kMode, .stroke_width = 1.5}},
      {"mode that does not", {.stroke = kMode, .stroke_width = 1.5, .dash = "3 2"}}};
  double y = top;
  double x = kMargin;
  for (const Entry& entry : entries) {
    if (y > top + 65.0) {
      y = top;
      x += 250.0;
    }
    svg->Line({x, y}, {x + 25.0, y}, entry.style);
    svg->Text({x + 32.0, y + 4.0}, entry.text, {.size = 11.0});
    y += 20.0;
  }
}

}  // namespace

std::string DrawTivPosterior(const TivWorld& world, const TivMineRun& run) {
  const MinePlan& plan = world.site().plan;
  const Frame frame(plan.modified);
  const Eigen::Vector2d size = frame.Size();
  Svg svg(size.x(), size.y());
  svg.Rect({0.0, 0.0}, size, {.fill = "white"});
  for (const Wall& wall : plan.original) {
    svg.Line(frame(wall.a), frame(wall.b), {.stroke = kOriginal, .stroke_width = 2.5});
  }
  for (const Wall& wall : plan.modified) {
    svg.Line(frame(wall.a), frame(wall.b), {.stroke = kModified, .stroke_width = 1.0});
  }
  DrawPath(run.truth, frame, {.stroke = kTruth, .stroke_width = 3.0}, &svg);
  DrawPath(run.fixed_poses, frame, {.stroke = kStatic, .stroke_width = 1.2}, &svg);
  DrawPath(run.multi_poses, frame, {.stroke = kMulti, .stroke_width = 1.2}, &svg);
  for (const Mode& mode : run.posterior.anonymous_landmarks) {
    DrawLandmark(mode, frame, {.stroke = kAnonymous, .stroke_width = 0.8}, &svg);
  }
  for (const LandmarkGroup& group : run.posterior.groups) {
    Eigen::Index likeliest = 0;
    group.probabilities.maxCoeff(&likeliest);
    for (std::size_t k = 0; k < group.modes.size(); ++k) {
      const bool holds = likeliest == static_cast<Eigen::Index>(k) + 1;
      DrawLandmark(group.modes[k],
                   frame,
                   {.stroke = kMode, .stroke_width = 1.5, .dash = holds ? "" : "3 2"},
                   &svg);
      svg.Text(frame(group.modes[k].p_map_landmark) + Eigen::Vector2d(6.0, -6.0),
               fmt::format("{}.{}", group.signature.text(), group.modes[k].number.value()),
               {.size = 10.0, .halo = true});
    }
  }
  constexpr double kBar = 10.0;  // [m]
  const Eigen::Vector2d bar(kMargin, size.y() - kLegend - 4.0);
  svg.Line(bar, bar + Eigen::Vector2d(kBar * kScale, 0.0), {.stroke = kMulti, .stroke_width = 2.0});
  svg.Text(bar + Eigen::Vector2d(kBar * kScale + 6.0, 4.0), "10 m", {.size = 11.0});
  DrawLegend(size.y() - kLegend + 24.0, &svg);
  return svg.ToString();
}

}  // namespace shiftmap
