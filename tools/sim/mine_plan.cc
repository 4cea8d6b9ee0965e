// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/mine_plan.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "tools/sim/option_checks.h"
#include "tools/sim/random.h"
#include "tools/sim/tunnels.h"

namespace shiftmap {
namespace {

// Bends of a drift's centre line: so far from each other, and across by this standard deviation.
constexpr double kBendEveryM = 12.0;
constexpr double kBendSdM = 0.7;

constexpr double kRoughStepM = 2.0;
constexpr double kMaxLengthM = 10000.0;

// Drawpoints lean towards the top by this, as loaders need to turn into them.
constexpr double kDrawpointAngleRad = 65.0 / 180.0 * std::numbers::pi;

// A barrier stands this far inside of the drift's wall, and reaches as far into the rock.
constexpr double kBarrierDepthM = 1.0;

// Niches, in the walls between drawpoints.
constexpr double kNicheProbability = 0.7;
constexpr double kNicheWidthM = 2.0;
constexpr double kNicheDepthM = 1.2;

// The bay with the corner that moves.
constexpr double kBayWidthM = 6.0;
constexpr double kBayDepthM = 2.5;

// Between the drifts, from centre to centre; beyond the outermost crosscuts the second one ends.
constexpr double kDriftSpacingM = 32.0;
constexpr double kSecondDriftEndM = 8.0;

// From the ends of the drift to those of the path.
constexpr double kPathMarginM = 6.0;

// Of random numbers: others of the same seed are for other things.
constexpr int kPlanStream = -1;

enum class Side { kLeft, kRight };

Side Other(Side side) { return side == Side::kLeft ? Side::kRight : Side::kLeft; }

struct Junction {
  bool crosscut = false;
  Side side = Side::kRight;
  double y_m = 0.0;
};

class Digger {
 public:
  explicit Digger(const MinePlanOptions& options)
      : options_(options), random_(MakeRandom(options.seed, kPlanStream)) {}

  MinePlan Dig() {
    DigDrift();
    PlaceJunctions();
    DigCrosscuts();
    DigDrawpoints();
    DigNiches();
    plan_.original = WallsOfUnion(original_);
    plan_.modified = WallsOfUnion(modified_);
    return std::move(plan_);
  }

 private:
  RoughRock Rock() const { return {options_.roughness_m, kRoughStepM}; }

  void Add(const Outline& outline) {
    original_.push_back(outline);
    modified_.push_back(outline);
  }

  // A line from `from` to `to` that bends sideways on its way.
  std::vector<Eigen::Vector2d> BentLine(const Eigen::Vector2d& from, const Eigen::Vector2d& to) {
    const Eigen::Vector2d ahead = to - from;
    const Eigen::Vector2d across(-ahead.normalized().y(), ahead.normalized().x());
    const int pieces = std::max(1, static_cast<int>(std::lround(ahead.norm() / kBendEveryM)));
    std::vector<Eigen::Vector2d> line = {from};
    for (int i = 1; i < pieces; ++i) {
      line.emplace_back(from + ahead * i / pieces + Gaussian(kBendSdM, &random_) * across);
    }
    line.push_back(to);
    return line;
  }

  void DigDrift() {
    drift_ = BentLine({0.0, 0.0}, {0.0, options_.length_m});
    Add(DigTunnel(drift_, options_.width_m, Rock(), &random_).ToOutline());
    const double end = LengthOf(drift_) - kPathMarginM;
    plan_.path.push_back(PointAlong(drift_, kPathMarginM));
    for (const Eigen::Vector2d& p : drift_) {
      if (p.y() > plan_.path.front().y() + 1.0 && p.y() < options_.length_m - kPathMarginM - 1.0) {
        plan_.path.push_back(p);
      }
    }
    plan_.path.push_back(PointAlong(drift_, end));
  }

  // Evenly along the drift; crosscuts spread among the drawpoints, which change sides.
  void PlaceJunctions() {
    const int count = options_.drawpoints + options_.crosscuts;
    Side side = Side::kRight;
    int crosscuts = 0;
    for (int i = 0; i < count; ++i) {
      Junction& junction = junctions_.emplace_back();
      junction.y_m = options_.length_m * (i + 0.8) / (count + 0.6);
      if ((i + 1) * options_.crosscuts / count > crosscuts) {
        ++crosscuts;
        junction.crosscut = true;
        junction.side = Side::kLeft;
      } else {
        junction.side = side;
        side = Other(side);
      }
    }
  }

  // The centre of the drift at a height: its line goes up.
  Eigen::Vector2d OnDrift(double y) const {
    const auto above = std::find_if(
        drift_.begin() + 1, drift_.end() - 1, [&](const auto& p) { return p.y() >= y; });
    const Eigen::Vector2d& low = *(above - 1);
    return low + (y - low.y()) / (above->y() - low.y()) * (*above - low);
  }

  static double Sign(Side side) { return side == Side::kLeft ? -1.0 : 1.0; }

  void DigCrosscuts() {
    double low = options_.length_m;
    double high = 0.0;
    for (const Junction& junction : junctions_) {
      if (!junction.crosscut) continue;
      low = std::min(low, junction.y_m);
      high = std::max(high, junction.y_m);
      const Eigen::Vector2d from = OnDrift(junction.y_m);
      Add(DigTunnel(
              BentLine(from, {-kDriftSpacingM, junction.y_m}), options_.width_m, Rock(), &random_)
              .ToOutline());
    }
    if (low > high) return;
    Add(DigTunnel(BentLine({-kDriftSpacingM, low - kSecondDriftEndM},
                           {-kDriftSpacingM, high + kSecondDriftEndM}),
                  options_.width_m,
                  Rock(),
                  &random_)
            .ToOutline());
  }

  void DigDrawpoints() {
    int drawpoint = 0;
    for (const Junction& junction : junctions_) {
      if (junction.crosscut) continue;
      const bool extended = drawpoint++ == options_.drawpoints / 2;
      DigDrawpoint(junction, extended);
    }
  }

  void DigDrawpoint(const Junction& junction, bool extended) {
    const Eigen::Vector2d start = OnDrift(junction.y_m);
    const Eigen::Vector2d ahead(Sign(junction.side) * std::sin(kDrawpointAngleRad),
                                std::cos(kDrawpointAngleRad));
    const Eigen::Vector2d end = start + options_.drawpoint_length_m * ahead;
    const std::vector<Eigen::Vector2d> centre = {start, end};
    const TunnelSides sides = DigTunnel(centre, options_.drawpoint_width_m, Rock(), &random_);
    original_.push_back(sides.ToOutline());
    modified_.push_back(sides.ToOutline());
    if (extended) {
      Extend(sides, ahead);
    } else {
      AddEntry(start, ahead);
    }
  }

  void Extend(const TunnelSides& sides, const Eigen::Vector2d& ahead) {
    const std::vector<Eigen::Vector2d> centre = {
        0.5 * (sides.left.back() + sides.right.back()),
        0.5 * (sides.left.back() + sides.right.back()) + options_.extension_m * ahead};
    const TunnelSides more = DigTunnel(centre, options_.drawpoint_width_m, Rock(), &random_);
    TunnelSides whole = sides;
    whole.left.insert(whole.left.end(), more.left.begin() + 1, more.left.end());
    whole.right.insert(whole.right.end(), more.right.begin() + 1, more.right.end());
    modified_.back() = whole.ToOutline();
    plan_.corners.push_back({sides.left.back(), whole.left.back()});
    plan_.corners.push_back({sides.right.back(), whole.right.back()});
  }

  void AddEntry(const Eigen::Vector2d& start, const Eigen::Vector2d& ahead) {
    const double depth = (0.5 * options_.width_m + kBarrierDepthM) / std::sin(kDrawpointAngleRad);
    const Eigen::Vector2d middle = start + (depth + kBarrierDepthM) * ahead;
    const Eigen::Vector2d left(-ahead.y(), ahead.x());
    const double reach = 0.5 * options_.drawpoint_width_m + kBarrierDepthM;
    plan_.entries.push_back({middle - reach * left, middle + reach * left});
  }

  // In the gap after the middle junction the bay, in others niches. All on the side of the junction
  // above: that below leans into the gap.
  void DigNiches() {
    const std::size_t bay = junctions_.size() / 2 - 1;
    for (std::size_t i = 0; i + 1 < junctions_.size(); ++i) {
      const Side side = Other(junctions_[i].side);
      const double y = 0.5 * (junctions_[i].y_m + junctions_[i + 1].y_m);
      if (i == bay) {
        DigBay(y, side);
      } else if (Happens(kNicheProbability, &random_)) {
        DigNiche(y, side);
      }
    }
  }

  // A recess with corners at the depths given, below and above.
  Outline Recess(double y, Side side, double width, double depth_below, double depth_above) const {
    const Eigen::Vector2d below = OnDrift(y - 0.5 * width);
    const Eigen::Vector2d above = OnDrift(y + 0.5 * width);
    const double wall = 0.5 * options_.width_m;
    const auto out = [&](double depth) {
      return Eigen::Vector2d(Sign(side) * (wall + depth), 0.0);
    };
    return {below, below + out(depth_below), above + out(depth_above), above};
  }

  void DigNiche(double y, Side side) {
    Add(Recess(y, side, kNicheWidthM, kNicheDepthM, kNicheDepthM));
  }

  void DigBay(double y, Side side) {
    const double nearer = kBayDepthM - options_.corner_shift_m;
    original_.push_back(Recess(y, side, kBayWidthM, kBayDepthM, kBayDepthM));
    modified_.push_back(Recess(y, side, kBayWidthM, kBayDepthM, nearer));
    plan_.corners.push_back({original_.back()[2], modified_.back()[2]});
  }

  MinePlanOptions options_;
  Random random_;
  MinePlan plan_;
  std::vector<Eigen::Vector2d> drift_;
  std::vector<Junction> junctions_;
  std::vector<Outline> original_;
  std::vector<Outline> modified_;
};

}  // namespace

Status MinePlanOptions::Validate() const {
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("drift length", length_m));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("tunnel width", width_m));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("drawpoint width", drawpoint_width_m));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("drawpoint length", drawpoint_length_m - width_m));
  SHIFTMAP_RETURN_IF_ERROR(CheckNotNegative("drawpoint extension", extension_m));
  SHIFTMAP_RETURN_IF_ERROR(CheckNotNegative("corner shift", corner_shift_m));
  SHIFTMAP_RETURN_IF_ERROR(CheckNotNegative("roughness", roughness_m));
  if (length_m > kMaxLengthM) {
    return InvalidArgument("world: drift length = {}, expected <= {}", length_m, kMaxLengthM);
  }
  if (corner_shift_m >= kBayDepthM) {
    return InvalidArgument("world: corner shift = {}, expected < {}", corner_shift_m, kBayDepthM);
  }
  if (drawpoints < 2 || crosscuts < 0) {
    return InvalidArgument(
        "world: {} drawpoints and {} crosscuts, expected >= 2 and >= 0", drawpoints, crosscuts);
  }
  const double spacing = length_m / (drawpoints + crosscuts + 0.6);
  if (spacing < kBayWidthM + 0.5 * drawpoint_width_m) {
    return InvalidArgument("world: {} drawpoints and {} crosscuts do not fit along {} m",
                           drawpoints,
                           crosscuts,
                           length_m);
  }
  return OkStatus();
}

StatusOr<MinePlan> GenerateMinePlan(const MinePlanOptions& options) {
  SHIFTMAP_RETURN_IF_ERROR(options.Validate());
  return Digger(options).Dig();
}

}  // namespace shiftmap
