// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/mine_files.h"

#include "mapstore/core/atomic_file.h"
#include "tools/plot/svg.h"

namespace shiftmap {
namespace {

constexpr const char* kOriginalColour = "#888888";
constexpr const char* kModifiedColour = "#222222";
constexpr const char* kBarrierColour = "#c0392b";
constexpr const char* kPathColour = "#4a90d9";

std::string WallRows(const char* version, const std::vector<Wall>& walls) {
  std::string rows;
  for (const Wall& wall : walls) {
    rows +=
        fmt::format("{},{},{},{},{}\n", version, wall.a.x(), wall.a.y(), wall.b.x(), wall.b.y());
  }
  return rows;
}

// Pixels of a picture, y down, around the walls.
class Frame {
 public:
  explicit Frame(const std::vector<Wall>& walls) {
    low_ = walls.empty() ? Eigen::Array2d(0.0, 0.0) : walls.front().a.array();
    high_ = low_;
    for (const Wall& wall : walls) {
      low_ = low_.min(wall.a.array()).min(wall.b.array());
      high_ = high_.max(wall.a.array()).max(wall.b.array());
    }
    low_ -= kMarginM;
    high_ += kMarginM;
    pixels_per_m_ = kLongerSide / (high_ - low_).maxCoeff();
  }

  Eigen::Vector2d Size() const { return pixels_per_m_ * (high_ - low_); }

  Eigen::Vector2d operator()(const Eigen::Vector2d& p) const {
    return pixels_per_m_ * Eigen::Vector2d(p.x() - low_.x(), high_.y() - p.y());
  }

 private:
  static constexpr double kMarginM = 3.0;
  static constexpr double kLongerSide = 1200.0;  // [px]

  Eigen::Array2d low_;
  Eigen::Array2d high_;
  double pixels_per_m_ = 1.0;
};

void DrawWalls(const std::vector<Wall>& walls,
               const SvgStyle& style,
               const Frame& frame,
               Svg* svg) {
  for (const Wall& wall : walls) svg->Line(frame(wall.a), frame(wall.b), style);
}

void DrawGroup(const SimulatedGroup& group, const Frame& frame, Svg* svg) {
  constexpr double kRadius = 3.0;
  for (std::size_t i = 0; i < group.modes.size(); ++i) {
    const Eigen::Vector2d at = frame(group.modes[i]);
    svg->Circle(at, kRadius, {.fill = kBarrierColour});
    svg->Text(at + Eigen::Vector2d(kRadius + 1.0, -kRadius),
              fmt::format("{}.{}", group.signature.text(), i + 1),
              {.size = 9.0, .halo = true});
  }
}

std::string Picture(const MineSite& site) {
  std::vector<Wall> all = site.plan.original;
  all.insert(all.end(), site.plan.modified.begin(), site.plan.modified.end());
  const Frame frame(all);
  const Eigen::Vector2d size = frame.Size();
  Svg svg(size.x(), size.y());
  svg.Rect({0.0, 0.0}, size, {.fill = "white"});
  DrawWalls(site.plan.original, {.stroke = kOriginalColour, .stroke_width = 2.5}, frame, &svg);
  DrawWalls(site.plan.modified, {.stroke = kModifiedColour, .stroke_width = 1.0}, frame, &svg);
  for (const std::vector<Wall>& barrier : site.barriers) {
    DrawWalls(barrier, {.stroke = kBarrierColour, .stroke_width = 1.5, .dash = "4 3"}, frame, &svg);
  }
  std::vector<Eigen::Vector2d> path;
  for (const Eigen::Vector2d& p : site.plan.path) path.push_back(frame(p));
  svg.Polyline(path, {.stroke = kPathColour, .stroke_width = 1.0, .dash = "6 4"});
  for (const SimulatedGroup& group : site.groups) DrawGroup(group, frame, &svg);
  return svg.ToString();
}

}  // namespace

Status WriteMinePlan(const MineSite& site, const std::string& directory) {
  const std::string rows = "version,x1_m,y1_m,x2_m,y2_m\n" +
                           WallRows("original", site.plan.original) +
                           WallRows("modified", site.plan.modified);
  SHIFTMAP_RETURN_IF_ERROR(WriteFileAtomically(directory + "/plan.csv", rows));
  return WriteFileAtomically(directory + "/plan.svg", Picture(site));
}

}  // namespace shiftmap
