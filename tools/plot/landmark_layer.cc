// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/landmark_layer.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "mapstore/core/quantile.h"
#include "tools/plot/confidence_ellipse.h"
#include "tools/plot/free_network.h"
#include "tools/plot/palette.h"

namespace shiftmap {
namespace {

constexpr double kLabelSize = 11.0;
constexpr double kSmallSize = 9.5;
constexpr double kNameWidth = 130.0;  // A longer signature is cut off.
constexpr const char* kModeColor = palette::kBlue;
constexpr const char* kAbsentColor = palette::kNote;
constexpr double kRing = 1.3;
constexpr double kLikely = 0.6;

// Labels may lie far from their landmark on maps of so few.
constexpr std::size_t kFewGroups = 80;
constexpr int kRings = 6;

const SvgStyle kLink{.stroke = "#777777", .stroke_width = 1.0, .opacity = 0.5, .dash = "4 4"};

// Drawn in steps of opacity where there are many.
constexpr std::array<double, 5> kOpacities = {0.1, 0.3, 0.5, 0.7, 0.95};

std::vector<const Mode*> AllModes(const MapContent& content) {
  std::vector<const Mode*> modes;
  for (const LandmarkGroup& group : content.groups) {
    for (const Mode& mode : group.modes) modes.push_back(&mode);
  }
  for (const Mode& mode : content.anonymous_landmarks) modes.push_back(&mode);
  return modes;
}

void DrawCross(const Eigen::Vector2d& at, double size, const SvgStyle& style, Svg* svg) {
  const Eigen::Vector2d a(size, size);
  const Eigen::Vector2d b(size, -size);
  svg->Line(at - a, at + a, style);
  svg->Line(at - b, at + b, style);
}

void DrawPlus(const Eigen::Vector2d& at, double size, const SvgStyle& style, Svg* svg) {
  svg->Line(at - Eigen::Vector2d(size, 0.0), at + Eigen::Vector2d(size, 0.0), style);
  svg->Line(at - Eigen::Vector2d(0.0, size), at + Eigen::Vector2d(0.0, size), style);
}

SvgStyle DotStyle(double probability, bool absent, double fade) {
  const char* const color = absent ? kAbsentColor : kModeColor;
  SvgStyle style{.stroke = color,
                 .stroke_width = kRing,
                 .fill = color,
                 .opacity = fade,
                 .fill_opacity = std::clamp(probability, 0.0, 1.0)};
  if (absent) style.dash = "2 1.5";
  return style;
}

void DrawDot(const Eigen::Vector2d& at,
             double radius,
             const SvgStyle& style,
             const std::string& tooltip,
             Svg* svg) {
  svg->Circle(at, radius, {.fill = palette::kPaper, .opacity = style.opacity});
  svg->Circle(at, radius, style, tooltip);
}

}  // namespace

Eigen::Index MostProbable(const LandmarkGroup& group) {
  Eigen::Index state = 0;
  group.probabilities.maxCoeff(&state);
  return state;
}

bool IsLikelyAbsent(const LandmarkGroup& group) { return group.probabilities(0) > kLikely; }

std::string PercentText(double probability) {
  if (probability < 0.005) return "< 1 %";
  if (probability > 0.995) return "> 99 %";
  return fmt::format("{:.0f} %", 100.0 * probability);
}

LandmarkLayer::LandmarkLayer(const MapContent& content, std::vector<Eigen::Vector2d> others)
    : content_(content) {
  const std::vector<const Mode*> modes = AllModes(content);
  many_ = modes.size() > kManyModes;
  // Half of the mean distance in a square full of them.
  if (!modes.empty()) {
    radius_ = std::clamp(110.0 / std::sqrt(static_cast<double>(modes.size())), 1.1, kRadius);
  }
  for (const Mode* mode : modes) others.push_back(mode->p_map_landmark);
  frame_ = MapFrame::Around(others);
  if (many_) return;
  FreeMap free = FreeNetwork(content);
  free_ = free.connected;
  content_ = std::move(free.content);
  scale_sd_ = free.scale_sd;
  ChooseMagnification();
  for (const Mode* mode : AllModes(content_)) {
    const Eigen::Vector2d half = Eigen::Vector2d::Constant(
        magnification_ * MakeEllipse(mode->cov_p_map_landmark).half_axes.x());
    others.emplace_back(mode->p_map_landmark - half);
    others.emplace_back(mode->p_map_landmark + half);
  }
  frame_ = MapFrame::Around(others);
}

void LandmarkLayer::ChooseMagnification() {
  std::vector<double> longer;
  std::vector<double> middle;
  for (const Mode* mode : AllModes(content_)) {
    const Eigen::Vector2d half =
        MakeEllipse(mode->cov_p_map_landmark).half_axes * frame_.pixels_per_m();
    longer.push_back(half.x());
    middle.push_back(std::sqrt(half.prod()));
  }
  if (longer.empty()) return;
  // Larger than the dots for half of the modes, unless that makes some of them very long.
  const double median = Quantile(middle, 0.5);
  const double large = Quantile(longer, 0.95);
  const double wanted = 1.8 * radius_;
  constexpr double kLargest = 48.0;
  for (const double factor : {2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0}) {
    if (magnification_ * median >= wanted || factor * large > kLargest) return;
    magnification_ = factor;
  }
}

void LandmarkLayer::DrawEllipse(const Mode& mode, const SvgStyle& style, Svg* svg) const {
  const ConfidenceEllipse ellipse = MakeEllipse(mode.cov_p_map_landmark);
  svg->Ellipse(frame_.Pixel(mode.p_map_landmark),
               ellipse.half_axes * magnification_ * frame_.pixels_per_m(),
               -ellipse.rotation_rad,
               style);
}

void LandmarkLayer::DrawGroup(const LandmarkGroup& group, double fade, Svg* svg) const {
  if (group.modes.empty()) return;
  const std::size_t main = MainMode(group);
  const bool absent = IsLikelyAbsent(group);
  SvgStyle link = kLink;
  link.opacity *= fade;
  for (std::size_t i = 0; i < group.modes.size(); ++i) {
    if (i == main) continue;
    svg->Line(frame_.Pixel(group.modes[main].p_map_landmark),
              frame_.Pixel(group.modes[i].p_map_landmark),
              link);
  }
  for (std::size_t i = 0; i < group.modes.size(); ++i) {
    const Mode& mode = group.modes[i];
    const double probability = group.probabilities(static_cast<Eigen::Index>(i + 1));
    const Eigen::Vector2d at = frame_.Pixel(mode.p_map_landmark);
    const SvgStyle style = DotStyle(probability, absent, fade);
    DrawEllipse(mode,
                {.stroke = style.stroke,
                 .stroke_width = 0.9,
                 .fill = style.stroke,
                 .opacity = fade * (0.4 + 0.5 * probability),
                 .fill_opacity = 0.25},
                svg);
    DrawDot(at,
            radius_,
            style,
            fmt::format("{} mode {}: ({:.2f}, {:.2f}) m, probability {:.3f}",
                        group.signature.text(),
                        mode.number.value(),
                        mode.p_map_landmark.x(),
                        mode.p_map_landmark.y(),
                        probability),
            svg);
    if (absent && i == main) {
      DrawCross(
          at, 1.6 * radius_, {.stroke = kAbsentColor, .stroke_width = kRing, .opacity = fade}, svg);
    }
  }
}

void LandmarkLayer::DrawMany(double fade, Svg* svg) const {
  std::array<std::vector<Eigen::Vector2d>, kOpacities.size()> dots;
  std::vector<Eigen::Vector2d> absent;
  std::vector<Eigen::Vector2d> links;
  for (const LandmarkGroup& group : content_.groups) {
    if (group.modes.empty()) continue;
    const std::size_t main = MainMode(group);
    const Eigen::Vector2d hub = frame_.Pixel(group.modes[main].p_map_landmark);
    if (IsLikelyAbsent(group)) absent.push_back(hub);
    for (std::size_t i = 0; i < group.modes.size(); ++i) {
      const Eigen::Vector2d at = frame_.Pixel(group.modes[i].p_map_landmark);
      const double p = group.probabilities(static_cast<Eigen::Index>(i + 1));
      const double step = std::clamp(p * static_cast<double>(dots.size()), 0.0, 4.0);
      dots[static_cast<std::size_t>(step)].push_back(at);
      if (i == main) continue;
      links.push_back(hub);
      links.push_back(at);
    }
  }
  svg->Segments(links, {.stroke = kLink.stroke, .stroke_width = 0.5, .opacity = 0.35 * fade});
  for (std::size_t i = 0; i < dots.size(); ++i) {
    svg->Dots(dots[i], radius_, kModeColor, fade * kOpacities[i]);
  }
  svg->Dots(absent, 0.6 * radius_ + 0.4, palette::kPaper, fade);
  svg->Dots(absent, 0.6 * radius_, palette::kVermillion, fade);
}

void LandmarkLayer::DrawAnonymous(double fade, Svg* svg) const {
  const SvgStyle style{.stroke = palette::kText, .stroke_width = 1.2, .opacity = fade};
  for (const Mode& mode : content_.anonymous_landmarks) {
    DrawPlus(frame_.Pixel(mode.p_map_landmark), std::max(1.5, 0.7 * radius_), style, svg);
  }
}

void LandmarkLayer::Draw(double fade, Svg* svg) const {
  DrawAnonymous(fade, svg);
  if (many_) {
    DrawMany(fade, svg);
    return;
  }
  for (const LandmarkGroup& group : content_.groups) DrawGroup(group, fade, svg);
}

LabelPlacer LandmarkLayer::MakePlacer() const {
  LabelPlacer placer(frame_.corner(), frame_.corner() + frame_.size());
  for (const Mode* mode : AllModes(content_)) {
    placer.Occupy(frame_.Pixel(mode->p_map_landmark), radius_ + 1.0);
  }
  return placer;
}

bool LandmarkLayer::Label(const LandmarkGroup& group,
                          std::size_t mode,
                          LabelPlacer* placer,
                          Svg* svg) const {
  const bool main = mode == MainMode(group);
  const bool absent = IsLikelyAbsent(group);
  const double size = main ? kLabelSize : kSmallSize;
  const std::string name =
      main ? Svg::Shortened(group.signature.text(), size, kNameWidth, true) : "";
  const std::string detail =
      main && absent
          ? fmt::format("absent {}", PercentText(group.probabilities(0)))
          : fmt::format("m{} {}",
                        group.modes[mode].number.value(),
                        PercentText(group.probabilities(static_cast<Eigen::Index>(mode + 1))));
  const double name_width = main ? Svg::TextWidth(name, size, true) + 4.0 : 0.0;
  const double detail_width = Svg::TextWidth(detail, kSmallSize);
  const Eigen::Vector2d point = frame_.Pixel(group.modes[mode].p_map_landmark);
  const bool few = content_.groups.size() <= kFewGroups;
  const double distance = radius_ + 2.0;
  // The long form near the landmark, then the short one, then farther out.
  bool whole = true;
  auto at =
      placer->Place(point, distance, {name_width + detail_width, 0.95 * size}, main && few ? 2 : 1);
  if (!at && main) {
    whole = false;
    at = placer->Place(point, distance, {name_width - 4.0, 0.95 * size}, few ? kRings : 1);
  }
  if (!at) return false;
  const double width = whole ? name_width + detail_width : name_width - 4.0;
  const Eigen::Vector2d anchor(std::clamp(point.x(), at->x(), at->x() + width),
                               std::clamp(point.y(), at->y() - 0.95 * size, at->y()));
  if ((anchor - point).norm() > distance + 8.0) {
    svg->Line(point, anchor, {.stroke = palette::kFaint, .stroke_width = 0.7});
  }
  const double base = at->y() - 0.12 * size;
  if (main) {
    svg->Text(
        {at->x(), base}, name, {.size = size, .fill = palette::kInk, .bold = true, .halo = true});
  }
  if (whole) {
    svg->Text({at->x() + name_width, base},
              detail,
              {.size = kSmallSize, .fill = palette::kText, .halo = true});
  }
  return true;
}

void LandmarkLayer::DrawLabels(LabelPlacer placer, Svg* svg) const {
  if (many_) return;
  for (const bool main : {true, false}) {
    for (const LandmarkGroup& group : content_.groups) {
      for (std::size_t i = 0; i < group.modes.size(); ++i) {
        if ((i == MainMode(group)) == main) Label(group, i, &placer, svg);
      }
    }
  }
}

void LandmarkLayer::AddTo(Legend* legend) const {
  legend->Heading("Landmarks");
  const double radius = std::max(radius_, 2.5);
  const bool many = many_;
  legend->Entry(
      [radius, many](const Eigen::Vector2d& at, Svg* svg) {
        for (const double p : {0.0, 0.5, 1.0}) {
          const Eigen::Vector2d dot = at + Eigen::Vector2d((p - 0.5) * 18.0, 0.0);
          if (many) {
            svg->Circle(dot, radius, {.fill = kModeColor, .opacity = 0.1 + 0.85 * p});
          } else {
            DrawDot(dot, radius, DotStyle(p, false, 1.0), "", svg);
          }
        }
      },
      "mode with probability 0, 50, 100 %");
  legend->Entry(
      [many](const Eigen::Vector2d& at, Svg* svg) {
        SvgStyle link = kLink;
        if (many) link.dash = "";
        svg->Line(at - Eigen::Vector2d(10.0, 0.0), at + Eigen::Vector2d(10.0, 0.0), link);
      },
      "modes of one landmark");
  if (!many_) {
    legend->Entry(
        [](const Eigen::Vector2d& at, Svg* svg) {
          svg->Ellipse(at,
                       {9.5, 6.0},
                       0.0,
                       {.stroke = kModeColor, .fill = kModeColor, .fill_opacity = 0.22});
        },
        magnification_ == 1.0
            ? std::string("95 % of the position (2.45 sigma)")
            : fmt::format("95 % of the position (2.45 sigma), drawn {:g} times as large",
                          magnification_));
  }
  legend->Entry(
      [radius, many](const Eigen::Vector2d& at, Svg* svg) {
        if (many) {
          svg->Circle(at, radius, {.fill = kModeColor, .opacity = kOpacities[1]});
          svg->Circle(at, 0.6 * radius, {.fill = palette::kVermillion});
          return;
        }
        DrawDot(at, radius, DotStyle(0.2, true, 1.0), "", svg);
        DrawCross(at, 1.6 * radius, {.stroke = kAbsentColor, .stroke_width = kRing}, svg);
      },
      fmt::format("likely absent: at none of its modes with more than {:.0f} %", 100.0 * kLikely));
  if (!content_.anonymous_landmarks.empty()) {
    legend->Entry(
        [](const Eigen::Vector2d& at, Svg* svg) {
          DrawPlus(at, 4.0, {.stroke = palette::kText, .stroke_width = 1.2}, svg);
        },
        "landmark without signature");
  }
  if (many_) legend->Note("too many for ellipses and labels");
  if (free_) {
    legend->Note(
        fmt::format("Ellipses are those of a free network: of positions to each other, without "
                    "what is common to "
                    "all, the frame and the scale (sd {:.2g} %).",
                    100.0 * scale_sd_));
  }
}

}  // namespace shiftmap
