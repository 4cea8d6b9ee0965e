// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/consistency_plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <map>

#include "mapstore/core/clock.h"
#include "mapstore/geometry/covariance.h"
#include "tools/plot/chart_frame.h"
#include "tools/plot/legend.h"
#include "tools/plot/palette.h"

namespace shiftmap {
namespace {

constexpr double kEdge = 12.0;
constexpr double kLeft = 62.0;
constexpr double kWidth = 700.0;
constexpr double kTop = 96.0;
constexpr double kHeight = 240.0;
constexpr double kBetween = 96.0;
constexpr double kBottom = 56.0;
constexpr std::size_t kMostDots = 20'000;
constexpr std::size_t kWindows = 50;
constexpr double kMaxGapS = 1.0;  // Of the truth.
constexpr int kBins = 10;
constexpr int kPoseDof = 3;

const SvgStyle kBand{.fill = palette::kSky, .opacity = 0.3};
const SvgStyle kExpected{.stroke = palette::kInk, .stroke_width = 1.0, .dash = "5 3"};

// Scans one after another, with their innovations summed.
struct Window {
  double begin_s;
  double end_s;
  double nis = 0.0;
  std::int64_t dof = 0;

  double Ratio() const { return nis / static_cast<double>(dof); }
  double Bound(double probability) const {
    return ChiSquareQuantile(probability, static_cast<int>(dof)) / static_cast<double>(dof);
  }
};

// Scans with innovations only.
std::vector<ScanConsistency> WithInnovations(const std::vector<ScanConsistency>& scans) {
  std::vector<ScanConsistency> kept;
  for (const ScanConsistency& scan : scans) {
    if (scan.dof > 0) kept.push_back(scan);
  }
  return kept;
}

std::vector<Window> Windows(const std::vector<ScanConsistency>& scans) {
  const std::size_t count = std::clamp<std::size_t>(scans.size() / 10, 1, kWindows);
  std::vector<Window> windows;
  for (std::size_t w = 0; w < count && !scans.empty(); ++w) {
    const std::size_t begin = scans.size() * w / count;
    const std::size_t end = scans.size() * (w + 1) / count;
    if (begin == end) continue;
    Window window{ToSecondsSinceEpoch(scans[begin].stamp),
                  ToSecondsSinceEpoch(scans[end - 1].stamp)};
    for (std::size_t i = begin; i < end; ++i) {
      window.nis += scans[i].nis;
      window.dof += scans[i].dof;
    }
    windows.push_back(window);
  }
  return windows;
}

struct Error {
  double stamp_s;
  double nees;
};

std::vector<Error> Errors(const std::vector<ScanConsistency>& scans,
                          const std::vector<StampedPose>& truth) {
  std::vector<Error> errors;
  for (const ScanConsistency& scan : scans) {
    const std::optional<Se2> T_map_truth = Interpolate(truth, scan.stamp, FromSeconds(kMaxGapS));
    if (!T_map_truth || !IsSymmetricPositiveDefinite(scan.pose.cov_T_map_vehicle)) continue;
    errors.push_back(
        {ToSecondsSinceEpoch(scan.stamp),
         SquaredMahalanobis(scan.pose.T_map_vehicle, *T_map_truth, scan.pose.cov_T_map_vehicle)});
  }
  return errors;
}

class ConsistencyPlot {
 public:
  ConsistencyPlot(const std::vector<ScanConsistency>& scans,
                  const std::optional<std::vector<StampedPose>>& truth)
      : scans_(WithInnovations(scans)),
        windows_(Windows(scans_)),
        has_truth_(truth.has_value()),
        first_(scans.front().stamp) {
    if (truth) errors_ = Errors(scans, *truth);
    time_ = {.label = "time (UTC)",
             .scale = AxisScale::kTime,
             .pixel_min = kLeft,
             .pixel_max = kLeft + kWidth};
    SetRange(
        ToSecondsSinceEpoch(scans.front().stamp), ToSecondsSinceEpoch(scans.back().stamp), &time_);
  }

  std::string Draw(const std::string& name) const;

 private:
  double Tail(const ScanConsistency& scan) const {
    return ChiSquareTail(scan.nis, static_cast<int>(scan.dof));
  }
  double MeanNees() const {
    double sum = 0.0;
    for (const Error& error : errors_) sum += error.nees;
    return sum / static_cast<double>(errors_.size());
  }
  void DrawNis(Svg* svg) const;
  void DrawNees(double top, Svg* svg) const;
  void DrawHistogram(const Eigen::Vector2d& corner, Svg* svg) const;
  Legend MakeLegend() const;
  void AddNis(Legend* legend) const;
  void AddNees(Legend* legend) const;

  std::vector<ScanConsistency> scans_;
  std::vector<Window> windows_;
  bool has_truth_;
  Stamp first_;  // Of all scans.
  std::vector<Error> errors_;
  ChartAxis time_;
};

void ConsistencyPlot::DrawNis(Svg* svg) const {
  double high = 2.5;
  for (const Window& window : windows_) {
    high = std::max({high, 1.2 * window.Ratio(), 1.2 * window.Bound(0.975)});
  }
  const ChartAxis y{.label = "NIS per degree of freedom [1]",
                    .min = 0.0,
                    .max = high,
                    .pixel_min = kTop + kHeight,
                    .pixel_max = kTop};
  DrawChartFrame(time_, y, svg);
  std::vector<Eigen::Vector2d> dots;
  const std::size_t skip = scans_.size() / kMostDots + 1;
  for (std::size_t i = 0; i < scans_.size(); i += skip) {
    const double ratio = scans_[i].nis / static_cast<double>(scans_[i].dof);
    if (ratio > high) continue;
    dots.emplace_back(time_.Pixel(ToSecondsSinceEpoch(scans_[i].stamp)), y.Pixel(ratio));
  }
  svg->Dots(dots, 1.2, palette::kNote, 0.25);
  std::vector<Eigen::Vector2d> band;
  for (const Window& window : windows_) {
    band.emplace_back(time_.Pixel(window.begin_s), y.Pixel(window.Bound(0.975)));
    band.emplace_back(time_.Pixel(window.end_s), y.Pixel(window.Bound(0.975)));
  }
  for (std::size_t i = windows_.size(); i-- > 0;) {
    const Window& window = windows_[i];
    band.emplace_back(time_.Pixel(window.end_s), y.Pixel(window.Bound(0.025)));
    band.emplace_back(time_.Pixel(window.begin_s), y.Pixel(window.Bound(0.025)));
  }
  svg->Polygon(band, kBand);
  svg->Line({kLeft, y.Pixel(1.0)}, {kLeft + kWidth, y.Pixel(1.0)}, kExpected);
  std::vector<Eigen::Vector2d> means;
  for (const Window& window : windows_) {
    means.emplace_back(time_.Pixel(0.5 * (window.begin_s + window.end_s)), y.Pixel(window.Ratio()));
  }
  svg->Polyline(means, {.stroke = palette::kVermillion, .stroke_width = 1.8});
  svg->Dots(means, 2.5, palette::kVermillion);
}

void ConsistencyPlot::DrawNees(double top, Svg* svg) const {
  double low = ChiSquareQuantile(0.025, kPoseDof);
  double high = ChiSquareQuantile(0.975, kPoseDof);
  const double band_low = low;
  const double band_high = high;
  constexpr double kLeast = 1e-2;
  for (const Error& error : errors_) {
    low = std::min(low, std::max(kLeast, error.nees));
    high = std::max(high, error.nees);
  }
  ChartAxis y{.label = "NEES of the pose, 3 degrees of freedom [1]",
              .scale = AxisScale::kLog,
              .pixel_min = top + kHeight,
              .pixel_max = top};
  SetRange(low, high, &y);
  DrawChartFrame(time_, y, svg);
  svg->Rect({kLeft, y.Pixel(band_high)}, {kWidth, y.Pixel(band_low) - y.Pixel(band_high)}, kBand);
  svg->Line({kLeft, y.Pixel(kPoseDof)}, {kLeft + kWidth, y.Pixel(kPoseDof)}, kExpected);
  std::vector<Eigen::Vector2d> line;
  for (const Error& error : errors_)
    line.emplace_back(time_.Pixel(error.stamp_s), y.Pixel(error.nees));
  if (line.size() > 1) {
    svg->Polyline(Condensed(line), {.stroke = palette::kBlue, .stroke_width = 1.0});
  }
}

void ConsistencyPlot::DrawHistogram(const Eigen::Vector2d& corner, Svg* svg) const {
  std::array<double, kBins> shares = {};
  for (const ScanConsistency& scan : scans_) {
    const auto bin = std::clamp(static_cast<int>(Tail(scan) * kBins), 0, kBins - 1);
    shares[static_cast<std::size_t>(bin)] += 100.0 / static_cast<double>(scans_.size());
  }
  const double most = *std::max_element(shares.begin(), shares.end());
  const ChartAxis x{.label = "probability of a larger NIS [1]",
                    .min = 0.0,
                    .max = 1.0,
                    .pixel_min = corner.x() + 40.0,
                    .pixel_max = corner.x() + Legend::kWidth - 8.0};
  const ChartAxis y{.label = "share of the scans [%]",
                    .min = 0.0,
                    .max = std::max(20.0, 1.1 * most),
                    .pixel_min = corner.y() + 160.0,
                    .pixel_max = corner.y()};
  DrawChartFrame(x, y, svg);
  for (int bin = 0; bin < kBins; ++bin) {
    const double share = shares[static_cast<std::size_t>(bin)];
    const double left = x.Pixel(static_cast<double>(bin) / kBins);
    const double right = x.Pixel(static_cast<double>(bin + 1) / kBins);
    svg->Rect({left + 1.0, y.Pixel(share)},
              {right - left - 2.0, y.Pixel(0.0) - y.Pixel(share)},
              {.fill = palette::kVermillion, .opacity = 0.7});
  }
  svg->Line(
      {x.pixel_min, y.Pixel(100.0 / kBins)}, {x.pixel_max, y.Pixel(100.0 / kBins)}, kExpected);
}

void ConsistencyPlot::AddNis(Legend* legend) const {
  double nis = 0.0;
  std::int64_t dof = 0;
  std::size_t beyond = 0;
  double high = 0.0;
  for (const ScanConsistency& scan : scans_) {
    nis += scan.nis;
    dof += scan.dof;
    if (Tail(scan) < 0.05) ++beyond;
    high = std::max(high, scan.nis / static_cast<double>(scan.dof));
  }
  legend->Heading("Innovations (NIS)");
  legend->Entry(
      [](const Eigen::Vector2d& at, Svg* svg) {
        svg->Circle(at - Eigen::Vector2d(4.0, 2.0), 1.5, {.fill = palette::kNote, .opacity = 0.5});
        svg->Circle(at + Eigen::Vector2d(3.0, 2.0), 1.5, {.fill = palette::kNote, .opacity = 0.5});
      },
      fmt::format("one scan; the largest is {:.3g}", high));
  legend->Entry(
      [](const Eigen::Vector2d& at, Svg* svg) {
        const Eigen::Vector2d half(10.0, 0.0);
        svg->Line(at - half, at + half, {.stroke = palette::kVermillion, .stroke_width = 1.8});
        svg->Circle(at, 2.5, {.fill = palette::kVermillion});
      },
      fmt::format("mean of about {} scans",
                  scans_.size() / std::max<std::size_t>(1, windows_.size())));
  legend->Entry(
      [](const Eigen::Vector2d& at, Svg* svg) {
        svg->Rect(at - Eigen::Vector2d(9.0, 6.0), {18.0, 12.0}, kBand);
      },
      "95 % band of that mean, if innovations are independent");
  legend->Entry(
      [](const Eigen::Vector2d& at, Svg* svg) {
        const Eigen::Vector2d half(10.0, 0.0);
        svg->Line(at - half, at + half, kExpected);
      },
      "expected");
  if (dof == 0) return;
  legend->Note(
      fmt::format("mean {:.3f} over {} degrees of freedom; 1 expected, above it the filter "
                  "is too sure of itself",
                  nis / static_cast<double>(dof),
                  dof));
  legend->Note(
      fmt::format("{:.1f} % of the scans above their 95 % quantile, 5 % expected",
                  100.0 * static_cast<double>(beyond) / static_cast<double>(scans_.size())));
}

void ConsistencyPlot::AddNees(Legend* legend) const {
  legend->Heading("Error of the pose (NEES)");
  if (errors_.empty()) {
    legend->Note("the truth covers no scan");
    return;
  }
  const double bound = ChiSquareQuantile(0.95, kPoseDof);
  const auto beyond = std::count_if(
      errors_.begin(), errors_.end(), [&](const Error& error) { return error.nees > bound; });
  legend->Entry(
      [](const Eigen::Vector2d& at, Svg* svg) {
        const Eigen::Vector2d half(10.0, 0.0);
        svg->Line(at - half, at + half, {.stroke = palette::kBlue, .stroke_width = 1.5});
      },
      "after each scan, with the 95 % band of one pose");
  legend->Note(
      fmt::format("mean {:.2f}, 3 expected; {:.1f} % above the 95 % quantile",
                  MeanNees(),
                  100.0 * static_cast<double>(beyond) / static_cast<double>(errors_.size())));
}

Legend ConsistencyPlot::MakeLegend() const {
  Legend legend;
  AddNis(&legend);
  if (has_truth_) AddNees(&legend);
  return legend;
}

std::string ConsistencyPlot::Draw(const std::string& name) const {
  const Legend legend = MakeLegend();
  constexpr double kHistogram = 240.0;
  const bool nees = !errors_.empty();
  const double column = kLeft + kWidth + 24.0;
  const double width = column + Legend::kWidth + kEdge;
  const double charts = kTop + kHeight + (nees ? kBetween + kHeight : 0.0) + kBottom;
  const double legend_top = kTop - 20.0;
  const double histogram_top = legend_top + legend.height() + 50.0;
  Svg svg(width, std::max(charts, scans_.empty() ? histogram_top : histogram_top + kHistogram));
  DrawTitles(
      fmt::format("{} · consistency", Svg::Shortened(name, 18.0, 600.0, true)),
      fmt::format("{} scans with observations, from {} UTC", scans_.size(), FormatUtc(first_)),
      kEdge,
      width - 2.0 * kEdge,
      &svg);
  legend.Draw({column, legend_top}, &svg);
  DrawNis(&svg);
  if (nees) DrawNees(kTop + kHeight + kBetween, &svg);
  if (!scans_.empty()) DrawHistogram({column, histogram_top}, &svg);
  return svg.ToString();
}

}  // namespace

std::vector<ScanConsistency> ScansOf(const ShiftRecording& recording) {
  std::map<Stamp, ScanConsistency> scans;
  for (const live::PoseEvent& pose : recording.poses) scans[pose.stamp].pose = pose.pose;
  for (const ScanInnovations& of_scan : recording.innovations) {
    ScanConsistency& scan = scans[of_scan.stamp];
    const NisSum nis = GatedNis(of_scan);
    scan.nis += nis.sum;
    scan.dof += 2 * nis.updates;
  }
  std::vector<ScanConsistency> list;
  for (auto& [stamp, scan] : scans) {
    scan.stamp = stamp;
    list.push_back(scan);
  }
  return list;
}

std::string PlotConsistency(const std::string& name,
                            const std::vector<ScanConsistency>& scans,
                            const std::optional<std::vector<StampedPose>>& truth) {
  return ConsistencyPlot(scans, truth).Draw(name);
}

}  // namespace shiftmap
