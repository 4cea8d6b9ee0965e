// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/history_plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>

#include "mapstore/core/clock.h"
#include "mapstore/core/count_text.h"
#include "mapstore/core/mode_name.h"
#include "tools/plot/chart_frame.h"
#include "tools/plot/landmark_layer.h"
#include "tools/plot/legend.h"
#include "tools/plot/palette.h"

namespace shiftmap {
namespace {

constexpr int kTimes = 400;
constexpr double kMaxSpanS = 9.2e9;  // Beyond this, seconds do not fit into a Duration.
constexpr std::size_t kMostVisitTimes = 600;

constexpr double kLeft = 78.0;
constexpr double kWidth = 740.0;
constexpr double kTop = 96.0;
constexpr double kHeight = 260.0;
constexpr double kVersions = 20.0;  // For the names of versions.
constexpr double kRow = 22.0;
constexpr double kBottom = 52.0;
constexpr double kEdge = 12.0;

// Strength of a visit's evidence, by the odds of its mode against the next.
struct Strength {
  double log_odds;  // At least.
  double opacity;
  const char* text;
};
const std::array<Strength, 3> kStrengths = {{{std::log(1000.0), 1.0, "1000 to 1 or more"},
                                             {std::log(10.0), 0.6, "10 to 1 or more"},
                                             {0.0, 0.3, "less than 10 to 1"}}};

std::size_t StrengthOf(const HistoryVisit& visit) {
  std::size_t i = 0;
  while (i + 1 < kStrengths.size() && visit.log_odds < kStrengths[i].log_odds) ++i;
  return i;
}

class HistoryPlot {
 public:
  HistoryPlot(const LandmarkHistory& history, const std::vector<VersionSummary>& versions)
      : history_(history), versions_(versions) {
    FindModes();
    SetAxes();
  }

  std::string Draw() const;

 private:
  void FindModes();
  void SetAxes();
  const char* ColorOf(ModeNumber mode) const {
    return mode == kAbsent
               ? palette::kFaint
               : palette::Cycle(palette::kModes, static_cast<std::size_t>(mode.value() - 1));
  }
  double RowY(ModeNumber mode) const {
    const auto at = std::find(modes_.begin(), modes_.end(), mode);
    return rows_top_ + kRow * (static_cast<double>(at - modes_.begin()) + 0.5);
  }
  double RowsBottom() const { return rows_top_ + kRow * static_cast<double>(modes_.size()); }
  double Pixel(Stamp stamp) const { return time_.Pixel(ToSecondsSinceEpoch(stamp)); }
  void DrawProbabilities(Svg* svg) const;
  void DrawVisits(Svg* svg) const;
  void DrawVersions(Svg* svg) const;
  Legend MakeLegend() const;

  const LandmarkHistory& history_;
  const std::vector<VersionSummary>& versions_;
  std::vector<ModeNumber> modes_;  // kAbsent last.
  ChartAxis time_;
  ChartAxis probability_;
  double rows_top_ = kTop + kHeight + kVersions;
};

void HistoryPlot::FindModes() {
  for (const ModeHistory& mode : history_.modes) modes_.push_back(mode.number);
  const auto add = [this](ModeNumber mode) {
    if (mode != kAbsent && std::find(modes_.begin(), modes_.end(), mode) == modes_.end()) {
      modes_.push_back(mode);
    }
  };
  for (const HistoryVisit& visit : history_.visits) add(visit.likely_mode);
  std::sort(modes_.begin(), modes_.end());
  modes_.push_back(kAbsent);
}

void HistoryPlot::SetAxes() {
  double first = ToSecondsSinceEpoch(history_.stamp);
  double last = first;
  const auto include = [&](Stamp stamp) {
    first = std::min(first, ToSecondsSinceEpoch(stamp));
    last = std::max(last, ToSecondsSinceEpoch(stamp));
  };
  for (const HistoryVisit& visit : history_.visits) {
    include(visit.begin);
    include(visit.end);
  }
  for (const ModeProbabilities& probabilities : history_.track) include(probabilities.stamp);
  const double margin = std::max(30.0, 0.02 * (last - first));
  time_ = {.label = "time (UTC)",
           .scale = AxisScale::kTime,
           .min = first - margin,
           .max = last + margin,
           .pixel_min = kLeft,
           .pixel_max = kLeft + kWidth};
  probability_ = {.label = "probability [%]",
                  .min = 0.0,
                  .max = 100.0,
                  .pixel_min = kTop + kHeight,
                  .pixel_max = kTop};
}

// Stacked, mode 1 at the bottom and `absent` on top.
void HistoryPlot::DrawProbabilities(Svg* svg) const {
  std::vector<double> below(history_.track.size(), 0.0);
  for (const ModeNumber mode : modes_) {
    std::vector<Eigen::Vector2d> lower;
    std::vector<Eigen::Vector2d> upper;
    for (std::size_t i = 0; i < history_.track.size(); ++i) {
      const ModeProbabilities& at = history_.track[i];
      if (at.modes.empty()) continue;
      lower.emplace_back(Pixel(at.stamp), probability_.Pixel(100.0 * below[i]));
      for (const ModeProbability& p : at.modes) {
        if (p.mode == mode) below[i] += p.probability;
      }
      upper.emplace_back(Pixel(at.stamp), probability_.Pixel(100.0 * below[i]));
    }
    if (lower.size() < 2) continue;
    lower.insert(lower.end(), upper.rbegin(), upper.rend());
    svg->Polygon(lower,
                 {.stroke = palette::kPaper,
                  .stroke_width = 0.6,
                  .fill = ColorOf(mode),
                  .opacity = mode == kAbsent ? 0.45 : 0.8},
                 ModeName(mode));
  }
}

void HistoryPlot::DrawVisits(Svg* svg) const {
  const SvgText name{.size = 11.0, .fill = palette::kText, .anchor = SvgAnchor::kEnd};
  // Ticks of one look in one element; of several in one pixel, one.
  std::map<std::pair<ModeNumber, std::size_t>, std::vector<Eigen::Vector2d>> ticks;
  std::vector<Eigen::Vector2d> aside;
  for (const HistoryVisit& visit : history_.visits) {
    const double x = 0.5 * (Pixel(visit.begin) + Pixel(visit.end));
    const double y = RowY(visit.current_mode.value_or(visit.likely_mode));
    const bool counts = !visit.set_aside;
    std::vector<Eigen::Vector2d>& row =
        counts ? ticks[{visit.current_mode.value_or(visit.likely_mode), StrengthOf(visit)}] : aside;
    if (!row.empty() && row.back().x() > x - 0.5 && std::abs(row.back().y() - y) < kRow / 2)
      continue;
    const Eigen::Vector2d half(0.0, counts ? 0.36 * kRow : 0.18 * kRow);
    row.push_back(Eigen::Vector2d(x, y) - half);
    row.push_back(Eigen::Vector2d(x, y) + half);
  }
  for (const ModeNumber mode : modes_) {
    const double y = RowY(mode);
    svg->Line({kLeft, y}, {kLeft + kWidth, y}, {.stroke = palette::kGrid});
    svg->Text({kLeft - 6.0, y + 4.0}, ModeName(mode), name);
  }
  for (const auto& [look, ends] : ticks) {
    svg->Segments(ends,
                  {.stroke = ColorOf(look.first),
                   .stroke_width = 2.0,
                   .opacity = kStrengths[look.second].opacity});
  }
  svg->Segments(aside, {.stroke = palette::kInk, .stroke_width = 1.0});
}

void HistoryPlot::DrawVersions(Svg* svg) const {
  double last_label = -1e9;
  for (const VersionSummary& version : versions_) {
    const double at_s = ToSecondsSinceEpoch(version.stamp);
    if (!(at_s >= time_.min && at_s <= time_.max)) continue;
    const double x = time_.Pixel(at_s);
    const SvgStyle line{.stroke = palette::kInk, .opacity = 0.6, .dash = "3 3"};
    svg->Line({x, kTop}, {x, kTop + kHeight}, line);
    svg->Line({x, rows_top_}, {x, RowsBottom()}, line);
    const std::string label = fmt::format("v{}", version.version.value());
    const double width = Svg::TextWidth(label, 10.0);
    if (x - 0.5 * width < last_label + 4.0) continue;
    last_label = x + 0.5 * width;
    svg->Text({x, kTop + kHeight + 14.0},
              label,
              {.size = 10.0, .fill = palette::kText, .anchor = SvgAnchor::kMiddle});
  }
}

Legend HistoryPlot::MakeLegend() const {
  constexpr std::size_t kListed = 12;
  Legend legend;
  legend.Heading("Probability of the modes");
  const auto swatch = [](const char* color) {
    return [color](const Eigen::Vector2d& at, Svg* svg) {
      svg->Rect(at - Eigen::Vector2d(8.0, 6.0), {16.0, 12.0}, {.fill = color, .opacity = 0.8});
    };
  };
  const std::vector<ModeProbability>& last =
      history_.track.empty() ? history_.probabilities : history_.track.back().modes;
  for (std::size_t i = 0; i < std::min(modes_.size(), kListed); ++i) {
    std::string text = ModeName(modes_[i]);
    for (const ModeProbability& p : last) {
      if (p.mode == modes_[i]) text += fmt::format(": {} at the end", PercentText(p.probability));
    }
    for (const ModeHistory& mode : history_.modes) {
      if (mode.number != modes_[i] || !mode.gone) continue;
      text += mode.merged_into ? fmt::format(": merged into mode {}", mode.merged_into->value())
                               : std::string(": gone");
    }
    legend.Entry(swatch(ColorOf(modes_[i])), text);
  }
  if (modes_.size() > kListed) legend.Note(fmt::format("and {} more", modes_.size() - kListed));
  legend.Heading("Visits, by the mode that each favours");
  for (const Strength& strength : kStrengths) {
    legend.Entry(
        [strength](const Eigen::Vector2d& at, Svg* svg) {
          svg->Line(at - Eigen::Vector2d(0.0, 7.0),
                    at + Eigen::Vector2d(0.0, 7.0),
                    {.stroke = palette::kBlue, .stroke_width = 2.0, .opacity = strength.opacity});
        },
        std::string("odds ") + strength.text);
  }
  legend.Entry(
      [](const Eigen::Vector2d& at, Svg* svg) {
        svg->Line(at - Eigen::Vector2d(0.0, 4.0),
                  at + Eigen::Vector2d(0.0, 4.0),
                  {.stroke = palette::kInk});
      },
      "does not count");
  legend.Entry(
      [](const Eigen::Vector2d& at, Svg* svg) {
        svg->Line(at - Eigen::Vector2d(0.0, 8.0),
                  at + Eigen::Vector2d(0.0, 8.0),
                  {.stroke = palette::kInk, .opacity = 0.6, .dash = "3 3"});
      },
      "map version, at the end of its newest run");
  return legend;
}

std::string HistoryPlot::Draw() const {
  const Legend legend = MakeLegend();
  const double column = kLeft + kWidth + 24.0;
  const double width = column + Legend::kWidth + kEdge;
  Svg svg(width, std::max(RowsBottom() + kBottom, kTop + legend.height() + kEdge));
  DrawTitles(
      fmt::format("{} · {} · version {}",
                  Svg::Shortened(history_.signature.text(), 18.0, 400.0, true),
                  history_.area,
                  history_.version.value()),
      fmt::format("{} · probabilities until {} UTC, as filtered",
                  CountText(history_.visits.size(), "visit"),
                  FormatUtc(history_.track.empty() ? history_.stamp : history_.track.back().stamp)),
      kEdge,
      width - 2.0 * kEdge,
      &svg);
  ChartAxis upper = time_;
  upper.ticks = false;
  DrawChartFrame(upper, probability_, &svg);
  DrawProbabilities(&svg);
  DrawChartFrame(
      time_,
      {.min = 0.0, .max = 1.0, .pixel_min = RowsBottom(), .pixel_max = rows_top_, .ticks = false},
      &svg);
  DrawVersions(&svg);
  DrawVisits(&svg);
  legend.Draw({column, kTop - 20.0}, &svg);
  return svg.ToString();
}

}  // namespace

std::vector<Stamp> EvenTimes(Stamp from, Stamp to, std::int64_t steps) {
  // In seconds: what a damaged store says may be further apart than nanoseconds count.
  const double span_s = ToSecondsSinceEpoch(to) - ToSecondsSinceEpoch(from);
  const bool sound = span_s > 0.0 && span_s < kMaxSpanS;
  std::vector<Stamp> times = {from};
  if (!sound) return times;
  for (std::int64_t i = 1; i < steps; ++i) {
    times.push_back(from +
                    FromSeconds(span_s / static_cast<double>(steps) * static_cast<double>(i)));
  }
  times.push_back(to);
  return times;
}

std::vector<Stamp> HistoryTimes(const std::vector<VisitSpan>& visits, Stamp version, Stamp end) {
  std::vector<Stamp> times;
  Stamp first = std::min(version, end);
  Stamp last = first;
  for (const VisitSpan& visit : visits) {
    first = std::min(first, visit.begin);
    last = std::max(last, visit.end);
  }
  // A little farther than the last visit, so that its outcome has a width.
  const double visited_s = ToSecondsSinceEpoch(last) - ToSecondsSinceEpoch(first);
  end = std::max({version, end, last + FromSeconds(0.04 * visited_s)});
  if (visits.size() <= kMostVisitTimes) {
    for (const VisitSpan& visit : visits) {
      times.push_back(visit.begin);
      times.push_back(visit.end);
    }
  }
  const std::vector<Stamp> even = EvenTimes(first, end, kTimes);
  times.insert(times.end(), even.begin(), even.end());
  std::sort(times.begin(), times.end());
  times.erase(std::unique(times.begin(), times.end()), times.end());
  return times;
}

std::string PlotHistory(const LandmarkHistory& history,
                        const std::vector<VersionSummary>& versions) {
  return HistoryPlot(history, versions).Draw();
}

}  // namespace shiftmap
