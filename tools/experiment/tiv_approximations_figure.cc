// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/tiv_approximations_figure.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "mapper/tree/tree_slam.h"
#include "tools/plot/confidence_ellipse.h"
#include "tools/plot/svg.h"

namespace shiftmap {
namespace {

constexpr int kScans = 48;
constexpr std::uint64_t kFigureSeed = 3;

// m_2^1 is just outside of the gate of m_1^1: A is as likely as it can be.
const Eigen::Vector2d kFirstMode(5.0, 2.0);     // m_1^1 [m]
const Eigen::Vector2d kFirstPlace(5.6, 3.1);    // m_2^1 [m]
const Eigen::Vector2d kActiveMode(12.0, -2.0);  // m_2^2 [m]
const Eigen::Vector2d kOtherMode(10.6, -3.4);   // m_1^2 [m]
constexpr double kAbsentPrior = 0.1;
constexpr double kOtherPrior = 0.1;

// A hypothesis counts as rejected if the other one is so many times as likely.
constexpr double kRejected = 100.0;

// Of the first landmark, in a tree that the prior map begins.
constexpr int kStateA = 1;
constexpr int kStateB = 2;

ApproximationsDriveOptions FigureOptions() {
  ApproximationsDriveOptions options;
  options.scans = kScans;
  options.sd_start_m = 0.25;
  options.sd_start_yaw_rad = 0.05;
  return options;
}

int FirstSight(const ApproximationsDrive& drive, const Signature& signature) {
  for (std::size_t i = 0; i < drive.scans.size(); ++i) {
    for (const Observation& observation : drive.scans[i].observations) {
      if (observation.signature == signature) return static_cast<int>(i);
    }
  }
  return static_cast<int>(drive.scans.size());
}

const GroupBelief* BeliefOf(const SlamLeaf& leaf, int group) {
  for (const GroupBelief& belief : leaf.beliefs) {
    if (belief.group == group) return &belief;
  }
  return nullptr;
}

// The state that the leaf has for active.
int ActiveState(const TreeSlam& slam, const SlamLeaf& leaf, int group) {
  Eigen::Index state = 0;
  const GroupBelief* const belief = BeliefOf(leaf, group);
  if (belief == nullptr) {
    slam.Probabilities(group).maxCoeff(&state);
  } else if (belief->resolved != GroupBelief::kUnresolved) {
    state = belief->resolved;
  } else {
    AsVector(belief->log_p).maxCoeff(&state);
  }
  return static_cast<int>(state);
}

std::vector<HypothesisMode> ModesOf(const TreeSlam& slam,
                                    const SlamLeaf& leaf,
                                    int state_of_first) {
  SlamMap map = leaf.filter;
  map.state().Focus(std::numeric_limits<double>::max());
  std::vector<HypothesisMode> modes;
  for (int group = 0; group < static_cast<int>(slam.groups().size()); ++group) {
    const int active = group == 0 ? state_of_first : ActiveState(slam, leaf, group);
    const auto count = slam.groups()[static_cast<std::size_t>(group)].modes.size();
    for (int state = 1; state <= static_cast<int>(count); ++state) {
      const int landmark = map.mode(group, state).landmark;
      if (landmark == SlamMap::kNoLandmark) continue;
      modes.push_back({group,
                       state,
                       map.state().Position(landmark),
                       map.state().PositionCovariance(landmark),
                       state == active});
    }
  }
  return modes;
}

// The leaf with most of a state of the first landmark.
const SlamLeaf* LeafOf(const TreeSlam& slam, int state) {
  const SlamLeaf* heaviest = nullptr;
  double most = kLogZero;
  for (const SlamLeaf* leaf : slam.leaves().all()) {
    const GroupBelief* const belief = BeliefOf(*leaf, 0);
    if (belief == nullptr || state >= belief->states()) continue;
    const double log_p = leaf->log_weight + belief->LogProbability(state);
    if (log_p > most) {
      most = log_p;
      heaviest = leaf;
    }
  }
  return heaviest;
}

std::optional<HypothesisView> ViewOf(const TreeSlam& slam, int state) {
  const SlamLeaf* const leaf = LeafOf(slam, state);
  if (leaf == nullptr) return std::nullopt;
  HypothesisView view;
  view.probability = slam.Probabilities(0)(state);
  view.pose = leaf->filter.Pose();
  view.modes = ModesOf(slam, *leaf, state);
  return view;
}

// From the returned scan on B is so many times as likely as A.
int BLeadsFrom(const std::vector<HypothesisPair>& pairs, double times) {
  auto scan = static_cast<int>(pairs.size());
  while (scan > 0) {
    const HypothesisPair& pair = pairs[static_cast<std::size_t>(scan) - 1];
    if (pair.ProbabilityOfB() <= times * pair.ProbabilityOfA()) break;
    --scan;
  }
  return std::min(scan, static_cast<int>(pairs.size()) - 1);
}

// Panels, two by two.
constexpr double kPanelWidth = 560.0;   // [px]
constexpr double kPanelHeight = 440.0;  // [px]
constexpr double kHeader = 44.0;        // Of a panel, for its title. [px]
constexpr double kLegendHeight = 70.0;  // [px]
constexpr double kPixelsPerMetre = 27.0;
constexpr double kLeft = -5.2;  // What panels show: from here on. [m]
constexpr double kTop = 7.0;    // [m]

constexpr const char* kColourA = "#009E73";  // Green and purple, as printed.
constexpr const char* kColourB = "#9440A0";
constexpr const char* kColourPrior = "#0072B2";
constexpr const char* kColourSecond = "#D55E00";  // Of L01 in the prior map.

class Panel {
 public:
  Panel(const TivFigureScene& scene, int column, int row, Svg* svg)
      : scene_(scene), corner_(column * kPanelWidth, row * kPanelHeight), svg_(*svg) {}

  void Frame(const std::string& title, const std::string& subtitle) {
    const Eigen::Vector2d corner = corner_ + Eigen::Vector2d(8.0, kHeader);
    svg_.Rect(corner, {kPanelWidth - 16.0, kPanelHeight - kHeader - 8.0}, {.stroke = "#999999"});
    svg_.Text(corner_ + Eigen::Vector2d(10.0, 18.0), title, {.size = 14.0, .bold = true});
    svg_.Text(corner_ + Eigen::Vector2d(10.0, 36.0), subtitle, {});
  }

  // The true way up to a scan, and where the landmarks stand.
  void Truth(int scan) {
    std::vector<Eigen::Vector2d> way = {Pixel(Eigen::Vector2d::Zero())};
    for (int i = 0; i <= scan; ++i) {
      way.push_back(Pixel(scene_.drive.T_map_vehicle[static_cast<std::size_t>(i)].translation()));
    }
    if (way.size() > 1) svg_.Polyline(way, {.stroke = "#999999", .stroke_width = 1.2});
    for (const TivLandmark& landmark : scene_.drive.landmarks) Cross(landmark.place);
  }

  void Vehicle(const PoseWithCovariance& pose, const char* colour) {
    const Se2& T = pose.T_map_vehicle;
    const Eigen::Matrix2d R = T.Rotation();
    Ellipse(T.translation(),
            R * pose.cov_T_map_vehicle.topLeftCorner<2, 2>() * R.transpose(),
            {.stroke = colour, .stroke_width = 1.5});
    svg_.Circle(Pixel(T.translation()), 3.5, {.fill = colour});
    svg_.Line(Pixel(T.translation()),
              Pixel(T * Eigen::Vector2d(1.0, 0.0)),
              {.stroke = colour, .stroke_width = 2.0});
  }

  void FieldOfView(const Se2& T_map_vehicle) {
    const SvgStyle black{.stroke = "#000000", .stroke_width = 1.2};
    const double radius = FigureOptions().max_range_m;
    svg_.Circle(Pixel(T_map_vehicle.translation()), radius * kPixelsPerMetre, black);
    svg_.Line(Pixel(T_map_vehicle.translation()),
              Pixel(T_map_vehicle * Eigen::Vector2d(radius, 0.0)),
              black);
  }

  void Mode(const HypothesisMode& mode, const char* colour) {
    Ellipse(mode.place,
            mode.cov,
            {.stroke = colour, .stroke_width = 1.5, .dash = mode.active ? "" : "4 3"});
    svg_.Circle(Pixel(mode.place),
                3.0,
                {.stroke = colour, .stroke_width = 1.2, .fill = mode.active ? colour : "#ffffff"});
  }

  void Hypothesis(const std::optional<HypothesisView>& view, const char* colour) {
    if (!view) return;
    for (const HypothesisMode& mode : view->modes) Mode(mode, colour);
    Vehicle(view->pose, colour);
  }

  void Label(const Eigen::Vector2d& p, const std::string& text) {
    svg_.Text(Pixel(p) + Eigen::Vector2d(10.0, -8.0), text, {.size = 12.0, .halo = true});
  }

 private:
  Eigen::Vector2d Pixel(const Eigen::Vector2d& p) const {
    return corner_ + Eigen::Vector2d(8.0 + (p.x() - kLeft) * kPixelsPerMetre,
                                     kHeader + (kTop - p.y()) * kPixelsPerMetre);
  }

  void Cross(const Eigen::Vector2d& p) {
    const SvgStyle line{.stroke = "#444444", .stroke_width = 1.4};
    const Eigen::Vector2d at = Pixel(p);
    svg_.Line(at - Eigen::Vector2d(5.0, 5.0), at + Eigen::Vector2d(5.0, 5.0), line);
    svg_.Line(at - Eigen::Vector2d(5.0, -5.0), at + Eigen::Vector2d(5.0, -5.0), line);
  }

  void Ellipse(const Eigen::Vector2d& p, const Eigen::Matrix2d& cov, const SvgStyle& style) {
    const ConfidenceEllipse shape = MakeEllipse(cov);
    svg_.Ellipse(Pixel(p), kPixelsPerMetre * shape.half_axes, -shape.rotation_rad, style);
  }

  const TivFigureScene& scene_;
  Eigen::Vector2d corner_;
  Svg& svg_;
};

void DrawPrior(const TivFigureScene& scene, Panel* panel) {
  panel->Frame("(a) prior map", "L00 stands at m₂¹, which the map does not have");
  panel->Truth(-1);
  panel->FieldOfView(scene.drive.start.T_map_vehicle);
  for (std::size_t g = 0; g < scene.drive.map.groups.size(); ++g) {
    const LandmarkGroup& group = scene.drive.map.groups[g];
    Eigen::Index active = 0;
    group.probabilities.maxCoeff(&active);
    for (std::size_t k = 0; k < group.modes.size(); ++k) {
      const auto state = static_cast<int>(k) + 1;
      panel->Mode({static_cast<int>(g),
                   state,
                   group.modes[k].p_map_landmark,
                   group.modes[k].cov_p_map_landmark,
                   state == active},
                  g == 0 ? kColourPrior : kColourSecond);
    }
  }
  panel->Vehicle(scene.drive.start, "#000000");
  panel->Label(kFirstMode, "m₁¹");
  panel->Label(kFirstPlace, "m₂¹");
  panel->Label(kActiveMode, "m₂²");
  panel->Label(kOtherMode, "m₁²");
}

void DrawMoment(const std::string& title,
                const TivFigureScene& scene,
                const std::vector<HypothesisPair>& pairs,
                int scan,
                Panel* panel) {
  const HypothesisPair& pair = pairs[static_cast<std::size_t>(scan)];
  panel->Frame(
      title,
      fmt::format("scan {}, {} after L00 was first seen: probability of A {:.2g}, of B {:.2g}",
                  scan + 1,
                  scan - scene.first_seen,
                  pair.ProbabilityOfA(),
                  pair.ProbabilityOfB()));
  panel->Truth(scan);
  panel->FieldOfView(scene.drive.T_map_vehicle[static_cast<std::size_t>(scan)]);
  panel->Hypothesis(pair.a, kColourA);
  panel->Hypothesis(pair.b, kColourB);
}

void DrawLegend(Svg* svg) {
  const double y = 2.0 * kPanelHeight + 20.0;
  const std::array<std::pair<const char*, const char*>, 2> hypotheses = {
      std::pair(kColourA, "A: L00 stands at m₁¹"),
      std::pair(kColourB, "B: L00 stands where it was seen")};
  double x = 20.0;
  for (const auto& [colour, text] : hypotheses) {
    svg->Circle({x, y - 4.0}, 5.0, {.fill = colour});
    svg->Text({x + 12.0, y}, text, {});
    x += 250.0;
  }
  svg->Text(
      {20.0, y + 26.0},
      "Ellipses hold 95 %. Dashed: an inactive mode. Crosses: where landmarks stand. Grey: the "
      "true way. Black: field of view and heading.",
      {});
}

}  // namespace

TivFigureScene MakeTivFigureScene() {
  const ApproximationsDriveOptions options = FigureOptions();
  TivFigureScene scene;
  ApproximationsDrive& drive = scene.drive;
  drive.map.calibration = TivCalibration(options);
  drive.map.stamp = TivScanStamp(-1);
  AddTivLandmark(options,
                 {LandmarkFate::kNewPlace, 1, kStateB, kFirstPlace},
                 {kFirstMode},
                 kAbsentPrior,
                 0.0,
                 &drive);
  AddTivLandmark(options,
                 {LandmarkFate::kStays, 2, 1, kActiveMode},
                 {kActiveMode, kOtherMode},
                 kAbsentPrior,
                 kOtherPrior,
                 &drive);
  const Eigen::Vector3d sd(options.sd_start_m, options.sd_start_m, options.sd_start_yaw_rad);
  drive.start.cov_T_map_vehicle = sd.cwiseAbs2().asDiagonal();
  Dice dice(kFigureSeed);
  DriveTiv(options, Se2(), 0.0, &drive, &dice, nullptr);
  scene.first_seen = FirstSight(drive, drive.map.groups[0].signature);
  scene.second_seen = FirstSight(drive, drive.map.groups[1].signature);
  return scene;
}

std::vector<HypothesisPair> FollowTivFigure(const TivFigureScene& scene, bool update_ungated) {
  const ApproximationsDrive& drive = scene.drive;
  TreeSlam slam({.update_ungated = update_ungated}, drive.map.calibration, drive.map);
  slam.BeginRun(drive.start, drive.map.calibration, drive.map.stamp);
  std::vector<HypothesisPair> pairs;
  for (std::size_t i = 0; i < drive.scans.size(); ++i) {
    slam.Predict(drive.motions[i]);
    slam.Correct(drive.scans[i]);
    pairs.push_back({ViewOf(slam, kStateA), ViewOf(slam, kStateB)});
  }
  return pairs;
}

TivFigureMoments FindTivFigureMoments(const TivFigureScene& scene,
                                      const std::vector<HypothesisPair>& ungated,
                                      const std::vector<HypothesisPair>& gated) {
  return {scene.second_seen - 1, BLeadsFrom(ungated, 1.0), BLeadsFrom(gated, kRejected)};
}

std::string DrawTivFigure(const TivFigureScene& scene,
                          const std::vector<HypothesisPair>& ungated,
                          const std::vector<HypothesisPair>& gated) {
  const TivFigureMoments moments = FindTivFigureMoments(scene, ungated, gated);
  const Eigen::Vector2d size(2.0 * kPanelWidth, 2.0 * kPanelHeight + kLegendHeight);
  Svg svg(size.x(), size.y());
  svg.Rect({0.0, 0.0}, size, {.fill = "#ffffff"});
  Panel a(scene, 0, 0, &svg);
  DrawPrior(scene, &a);
  Panel b(scene, 1, 0, &svg);
  DrawMoment("(b) every observation corrects", scene, ungated, moments.adapted, &b);
  Panel c(scene, 0, 1, &svg);
  DrawMoment("(c) every observation corrects, L01 in view", scene, ungated, moments.selected, &c);
  Panel d(scene, 1, 1, &svg);
  DrawMoment("(d) only what gates corrects", scene, gated, moments.rejected, &d);
  DrawLegend(&svg);
  return svg.ToString();
}

}  // namespace shiftmap
