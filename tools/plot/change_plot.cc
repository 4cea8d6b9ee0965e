// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/change_plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "mapstore/core/clock.h"
#include "mapstore/core/count_text.h"
#include "mapstore/core/quantile.h"
#include "tools/plot/label_placer.h"
#include "tools/plot/landmark_layer.h"
#include "tools/plot/map_changes.h"
#include "tools/plot/palette.h"
#include "tools/plot/run_layer.h"
#include "tools/plot/ticks.h"

namespace shiftmap {
namespace {

constexpr std::size_t kListed = 10;       // Lines of a list.
constexpr std::size_t kMostLabels = 150;  // Of the most important changes.
constexpr double kLabelSize = 10.5;
constexpr int kRings = 8;

struct Kind {
  const char* color;
  const char* text;
};

// By ChangeKind.
constexpr std::array<Kind, kChangeKinds> kKinds = {{
    {palette::kBlue, "stands at another mode"},
    {palette::kVermillion, "left: likely absent now"},
    {palette::kGreen, "came back: was likely absent"},
    {palette::kGreen, "new landmark"},
    {palette::kVermillion, "landmark gone from the map"},
    {palette::kGreen, "new mode"},
    {palette::kVermillion, "mode gone"},
    {palette::kPurple, "mode merged into another"},
    {palette::kOrange, "estimate moved"},
    {palette::kSky, "other change of probability above 10 %"},
}};

const Kind& KindOf(ChangeKind kind) { return kKinds[static_cast<std::size_t>(kind)]; }

// Draws a change of a kind with the ends of its arrow.
void DrawChange(ChangeKind kind,
                const Eigen::Vector2d& from,
                const Eigen::Vector2d& to,
                double size,
                Svg* svg) {
  const char* const color = KindOf(kind).color;
  const SvgStyle line{.stroke = color, .stroke_width = 2.0};
  const Eigen::Vector2d a(size, size);
  const Eigen::Vector2d b(size, -size);
  switch (kind) {
    case ChangeKind::kStandsElsewhere:
      svg->Circle(
          from, 0.8 * size, {.stroke = color, .stroke_width = 1.4, .fill = palette::kPaper});
      svg->Arrow(from, to, 11.0, line);
      svg->Circle(to, 0.8 * size, {.fill = color});
      break;
    case ChangeKind::kMergedMode:
    case ChangeKind::kMovedEstimate:
      svg->Arrow(from, to, 8.0, line);
      break;
    case ChangeKind::kLeft:
    case ChangeKind::kGoneLandmark:
    case ChangeKind::kGoneMode:
      svg->Line(to - a, to + a, line);
      svg->Line(to - b, to + b, line);
      if (kind == ChangeKind::kLeft) svg->Circle(to, 1.5 * size, {.stroke = color});
      break;
    case ChangeKind::kCameBack:
      svg->Circle(to, 1.5 * size, {.stroke = color});
      [[fallthrough]];
    case ChangeKind::kNewLandmark:
      svg->Circle(to, size, {.fill = color});
      break;
    case ChangeKind::kNewMode:
      svg->Circle(to, size, {.stroke = color, .stroke_width = 2.2, .fill = palette::kPaper});
      break;
    case ChangeKind::kProbability:
      svg->Circle(to, 1.3 * size, {.stroke = color, .stroke_width = 2.0});
      break;
  }
}

class ChangePlot {
 public:
  // @param from  May be empty.
  ChangePlot(const MapContent& from, const MapSnapshot& to, const RunLayer* runs)
      : to_(to),
        changes_(FindChanges(from, to.content())),
        runs_(runs),
        landmarks_(to.content(), OtherPoints()) {
    ChooseMagnification();
  }

  const MapChanges& changes() const { return changes_; }
  void AddTo(Legend* legend) const;
  std::string Draw(const MapPage& page, const Legend& legend) const;

 private:
  std::vector<Eigen::Vector2d> OtherPoints() const;
  void ChooseMagnification();
  Eigen::Vector2d Start(const MapChange& change) const;
  void DrawLabels(Svg* svg) const;

  const MapSnapshot& to_;
  MapChanges changes_;
  const RunLayer* runs_;  // Null for none.
  LandmarkLayer landmarks_;
  double magnification_ = 1.0;  // Of the moves of estimates.
};

std::vector<Eigen::Vector2d> ChangePlot::OtherPoints() const {
  std::vector<Eigen::Vector2d> points;
  if (runs_ != nullptr) points = runs_->Positions();
  for (const MapChange& change : changes_.changes) {
    points.push_back(change.p_from);
    points.push_back(change.p_to);
  }
  return points;
}

void ChangePlot::ChooseMagnification() {
  std::vector<double> lengths;
  for (const MapChange& change : changes_.changes) {
    if (change.kind != ChangeKind::kMovedEstimate) continue;
    lengths.push_back((change.p_to - change.p_from).norm() * landmarks_.frame().pixels_per_m());
  }
  if (lengths.empty()) return;
  constexpr double kSeen = 16.0;
  constexpr double kLongest = 60.0;
  const double median = Quantile(lengths, 0.5);
  const double longest = Quantile(lengths, 1.0);
  for (double factor = 2.0; magnification_ * median < kSeen && factor * longest <= kLongest;
       factor = NiceStep(1.01 * factor)) {
    magnification_ = factor;
  }
}

// Arrows of moves end where the mode is, and begin so far off as to be seen; inside the frame.
Eigen::Vector2d ChangePlot::Start(const MapChange& change) const {
  const MapFrame& frame = landmarks_.frame();
  const Eigen::Vector2d to = frame.Pixel(change.p_to);
  const Eigen::Vector2d from = frame.Pixel(change.p_from);
  if (change.kind != ChangeKind::kMovedEstimate) return from;
  return (to + magnification_ * (from - to))
      .cwiseMax(frame.corner())
      .cwiseMin(frame.corner() + frame.size());
}

void ChangePlot::AddTo(Legend* legend) const {
  legend->Heading("Changes");
  for (std::size_t i = 0; i < kChangeKinds; ++i) {
    if (changes_.counts[i] == 0) continue;
    const auto kind = static_cast<ChangeKind>(i);
    std::string text = fmt::format("{}: {}", KindOf(kind).text, changes_.counts[i]);
    if (kind == ChangeKind::kMovedEstimate) {
      text = fmt::format("{}, by more than chance (p < 0.01)", text);
      if (magnification_ > 1.0) text += fmt::format("; drawn {:g} times as long", magnification_);
    }
    legend->Entry(
        [kind](const Eigen::Vector2d& at, Svg* svg) {
          const Eigen::Vector2d half(8.0, 0.0);
          const bool arrow = kind == ChangeKind::kStandsElsewhere ||
                             kind == ChangeKind::kMergedMode || kind == ChangeKind::kMovedEstimate;
          DrawChange(kind, arrow ? at - half : at, arrow ? at + half : at, 4.0, svg);
        },
        text);
  }
  if (changes_.changes.empty()) legend->Note("none that a picture shows");
  if (changes_.small_moves > 0) {
    legend->Note(fmt::format("{} modes moved no more than chance does", changes_.small_moves));
  }
  legend->Entry(
      [](const Eigen::Vector2d& at, Svg* svg) { svg->Circle(at, 3.5, {.fill = "#C4C4C4"}); },
      "other modes");
}

void ChangePlot::DrawLabels(Svg* svg) const {
  const MapFrame& frame = landmarks_.frame();
  LabelPlacer placer(frame.corner(), frame.corner() + frame.size());
  for (const MapChange& change : changes_.changes) {
    placer.Occupy(frame.Pixel(change.p_to), 7.0);
    placer.OccupyLine(Start(change), frame.Pixel(change.p_to), 5.0);
  }
  const bool few = changes_.changes.size() <= kMostLabels;
  std::size_t labels = 0;
  for (const MapChange& change : changes_.changes) {
    if (change.detail.empty()) continue;
    if (++labels > kMostLabels) break;
    const std::string name = Svg::Shortened(change.signature.text(), kLabelSize, 120.0, true);
    const double name_width = Svg::TextWidth(name, kLabelSize, true) + 4.0;
    const double width = name_width + Svg::TextWidth(change.detail, kLabelSize);
    const Eigen::Vector2d point = frame.Pixel(change.p_to);
    const auto at = placer.Place(point, 9.0, {width, kLabelSize}, few ? kRings : 1);
    if (!at) continue;
    const Eigen::Vector2d anchor(std::clamp(point.x(), at->x(), at->x() + width),
                                 std::clamp(point.y(), at->y() - kLabelSize, at->y()));
    if ((anchor - point).norm() > 20.0) {
      svg->Line(point, anchor, {.stroke = palette::kFaint, .stroke_width = 0.7});
    }
    const double base = at->y() - 0.15 * kLabelSize;
    svg->Text({at->x(), base},
              name,
              {.size = kLabelSize, .fill = palette::kInk, .bold = true, .halo = true});
    svg->Text({at->x() + name_width, base},
              change.detail,
              {.size = kLabelSize, .fill = palette::kText, .halo = true});
  }
}

std::string ChangePlot::Draw(const MapPage& page, const Legend& legend) const {
  Svg svg = StartMapPage(page, landmarks_.frame(), legend);
  if (runs_ != nullptr) runs_->Draw(landmarks_.frame(), &svg);
  std::vector<Eigen::Vector2d> others;
  for (const LandmarkGroup& group : to_.groups()) {
    for (const Mode& mode : group.modes) {
      others.push_back(landmarks_.frame().Pixel(mode.p_map_landmark));
    }
  }
  svg.Dots(others, std::min(3.5, landmarks_.radius()), "#C4C4C4");
  const double size = std::clamp(landmarks_.radius() + 0.5, 2.0, 4.5);
  for (std::size_t i = changes_.changes.size(); i-- > 0;) {
    const MapChange& change = changes_.changes[i];
    DrawChange(change.kind, Start(change), landmarks_.frame().Pixel(change.p_to), size, &svg);
  }
  DrawLabels(&svg);
  return svg.ToString();
}

void AddList(const std::string& heading, const std::vector<std::string>& lines, Legend* legend) {
  legend->Heading(fmt::format("{}: {}", heading, lines.size()));
  for (std::size_t i = 0; i < std::min(lines.size(), kListed); ++i) legend->Note(lines[i], true);
  if (lines.size() > kListed) legend->Note(fmt::format("and {} more", lines.size() - kListed));
}

std::string ExclusionText(const Exclusion& exclusion) {
  const bool run = exclusion.vehicle.empty();
  return fmt::format("{} {}: {}",
                     run ? "run" : "vehicle",
                     Svg::Shortened(run ? exclusion.run : exclusion.vehicle, 11.0, 90.0),
                     exclusion.reason);
}

std::string MinuteText(Stamp stamp) { return FormatUtc(stamp).substr(0, 16); }

void AddRunLists(const Night& night, Legend* legend) {
  std::vector<std::string> waiting;
  for (const UnplacedRun& run : night.waiting) {
    waiting.push_back(
        fmt::format("{} since {}", Svg::Shortened(run.name, 11.0, 100.0), MinuteText(run.since)));
  }
  std::vector<std::string> held;
  std::vector<std::string> excluded;
  for (const Exclusion& exclusion : night.exclusions) {
    (exclusion.held ? held : excluded).push_back(ExclusionText(exclusion));
  }
  AddList("Waiting for another build", waiting, legend);
  AddList("Held", held, legend);
  if (!excluded.empty()) AddList("Excluded", excluded, legend);
}

// What the comparison leaves out.
void AddCarried(const EarlierMap& from, Legend* legend) {
  if (from.moved)
    legend->Note(fmt::format("The frame {}; that is taken out.", FrameText(*from.moved)));
  if (from.renamed.empty()) return;
  const auto& [before, after] = from.renamed.front();
  const std::size_t others = from.renamed.size() - 1;
  legend->Note(fmt::format("Renamed: {} to {}{}",
                           Svg::Shortened(before.text(), 11.0, 80.0),
                           Svg::Shortened(after.text(), 11.0, 80.0),
                           others == 0 ? "" : fmt::format(", and {} more", others)));
}

}  // namespace

std::string FrameText(const Se2& T_to_from) {
  const std::string moved =
      fmt::format("moved by ({:.2f}, {:.2f}) m", T_to_from.x(), T_to_from.y());
  const double degrees = T_to_from.yaw() * 180.0 / std::numbers::pi;
  if (std::abs(degrees) < 0.005) return moved;
  return fmt::format("turned by {:.2f}° about the origin and {}", degrees, moved);
}

std::string PlotDiff(const EarlierMap& earlier, const MapSnapshot& to) {
  const MapSnapshot& from = earlier.map;
  const ChangePlot plot(from.content(), to, nullptr);
  Legend legend;
  plot.AddTo(&legend);
  AddCarried(earlier, &legend);
  return plot.Draw(
      {.title = fmt::format(
           "{} · version {} to {}", to.area(), from.version().value(), to.version().value()),
       .subtitle = fmt::format("probabilities at {} and {} UTC · {} and {} landmarks",
                               MinuteText(from.stamp()),
                               MinuteText(to.stamp()),
                               from.groups().size(),
                               to.groups().size())},
      legend);
}

std::string PlotNight(const MapSnapshot& map, const Night& night) {
  const std::vector<RunRecord> none;
  const RunLayer runs(night.mapped, none);
  const MapContent nothing;
  const ChangePlot plot(night.parent ? night.parent->map.content() : nothing, map, &runs);
  Legend legend;
  plot.AddTo(&legend);
  if (night.parent) AddCarried(*night.parent, &legend);
  runs.AddTo(&legend);
  AddRunLists(night, &legend);
  const std::string since =
      night.parent ? fmt::format("since version {}", night.parent->map.version().value())
                   : std::string("no version before");
  return plot.Draw(
      {.title = fmt::format("{} · version {} · {}", map.area(), map.version().value(), since),
       .subtitle = fmt::format("probabilities at {} UTC · {} · runs mapped: {}",
                               MinuteText(map.stamp()),
                               CountText(map.groups().size(), "landmark"),
                               night.mapped.size())},
      legend);
}

}  // namespace shiftmap
