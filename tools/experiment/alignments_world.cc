// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/alignments_world.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <utility>

#include "mapper/alignment/move_prior.h"
#include "mapper/covariance/gauge.h"
#include "mapper/rows.h"
#include "tools/experiment/dice.h"

namespace shiftmap {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kRackSide = 1.5;  // [m]

// The covariance of a map of these places (DrawAlignmentPair).
Eigen::MatrixXd DrawCovariance(const std::vector<Eigen::Vector2d>& places, Dice* dice) {
  constexpr int kBends = 8;
  constexpr double kMaxSdBend = 0.03;  // [rad]
  constexpr double kSdScale = 0.01;
  const double heading = dice->Uniform(-kPi, kPi);
  const Eigen::Vector2d along(std::cos(heading), std::sin(heading));
  const double sd_bend = dice->Uniform(0.0, kMaxSdBend) / std::sqrt(kBends);
  const double sd_own = dice->Uniform(0.02, 0.06);
  const Eigen::VectorXd offsets = OffsetsFromCentroid(places);
  const Eigen::Index rows = offsets.size();
  const Eigen::VectorXd way = offsets.reshaped(2, rows / 2).transpose() * along;
  // What the errors in common do to the places, a column each.
  Eigen::MatrixXd common = Eigen::MatrixXd::Zero(rows, kBends + 1);
  common.col(kBends) = kSdScale * offsets;
  for (int bend = 0; bend < kBends; ++bend) {
    const double share = (bend + 0.5) / kBends;
    const double at = (1.0 - share) * way.minCoeff() + share * way.maxCoeff();
    for (Eigen::Index i = 0; i < way.size(); ++i) {
      if (way[i] <= at) continue;  // Passed before.
      const Eigen::Vector2d arm = offsets.segment<2>(2 * i) - at * along;
      common.block<2, 1>(2 * i, bend) = sd_bend * Eigen::Vector2d(-arm.y(), arm.x());
    }
  }
  Eigen::MatrixXd covariance = common * common.transpose();
  covariance.diagonal().array() += sd_own * sd_own;
  return ReferToPositions(places, std::move(covariance));
}

// A map of the places, with errors drawn from its covariance.
// @param groups  Of the places.
JointPoints DrawMap(const std::vector<Eigen::Vector2d>& places,
                    const std::vector<int>& groups,
                    Dice* dice) {
  JointPoints map;
  map.covariance = DrawCovariance(places, dice);
  Eigen::VectorXd errors(map.covariance.rows());
  for (double& error : errors) error = dice->Normal();
  errors = map.covariance.llt().matrixL() * errors;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const Eigen::Index row = RowOf(i);
    map.points.push_back({GroupIndex(groups[i]),
                          places[i] + errors.segment<2>(row),
                          map.covariance.block<2, 2>(row, row)});
  }
  return map;
}

void Transform(const Se2& T, double scale, JointPoints* map) {
  const Eigen::Matrix2d R = scale * T.Rotation();
  for (Eigen::Index i = 0; i + 1 < map->covariance.rows(); i += 2) {
    map->covariance.middleRows<2>(i) = (R * map->covariance.middleRows<2>(i)).eval();
  }
  for (Eigen::Index i = 0; i + 1 < map->covariance.cols(); i += 2) {
    map->covariance.middleCols<2>(i) = (map->covariance.middleCols<2>(i) * R.transpose()).eval();
  }
  for (const ModeIndex i : map->points.indices()) {
    AlignmentPoint& point = map->points[i];
    point.position = T.translation() + R * point.position;
    point.cov = map->covariance.block<2, 2>(RowOf(i), RowOf(i));
  }
}

class PairDraw {
 public:
  PairDraw(AlignmentWorld world, std::uint64_t seed)
      : world_(world), dice_(seed), side_(dice_.Uniform(8.0, 20.0)) {}

  AlignmentPair Draw() {
    const std::size_t most = world_ == AlignmentWorld::kPrior ? 14 : 40;
    const std::size_t count = Integer(5, most);
    switch (world_) {
      case AlignmentWorld::kPrior:
        DrawPrior(count);
        break;
      case AlignmentWorld::kSpread:
        Scatter(count);
        MoveAnyOf(Order(count), dice_.Uniform(0.1, 1.0));
        break;
      case AlignmentWorld::kCorner:
        DrawCorner(count);
        break;
      case AlignmentWorld::kSymmetric:
        DrawSymmetric(count);
        break;
      case AlignmentWorld::kSwappedRacks:
        DrawRacks(count, 2);
        break;
      case AlignmentWorld::kRackMoved:
        DrawRacks(count, 1);
        break;
      case AlignmentWorld::kNone:
        Scatter(count);
        MoveAnyOf(Order(count), 1.0);
        break;
      case AlignmentWorld::kReturns:
        DrawReturns(count);
        break;
    }
    return Finish();
  }

 private:
  std::size_t Integer(std::size_t low, std::size_t high) {
    return low + static_cast<std::size_t>(dice_.Uniform(0.0, static_cast<double>(high - low + 1)));
  }

  Eigen::Vector2d Anywhere() { return {dice_.Uniform(0.0, side_), dice_.Uniform(0.0, side_)}; }

  Eigen::Vector2d Step(double length) {
    const double direction = dice_.Uniform(-kPi, kPi);
    return length * Eigen::Vector2d(std::cos(direction), std::sin(direction));
  }

  // The landmarks in a random order.
  std::vector<std::size_t> Order(std::size_t count) {
    std::vector<std::size_t> order(count);
    std::iota(order.begin(), order.end(), 0U);
    for (std::size_t i = 0; i + 1 < count; ++i) std::swap(order[i], order[Integer(i, count - 1)]);
    return order;
  }

  void Scatter(std::size_t count) {
    while (before_.size() < count) before_.push_back(Anywhere());
    after_ = before_;
  }

  Eigen::Vector2d Moved(const Eigen::Vector2d& place) {
    if (dice_.Coin(0.5)) return Anywhere();
    const double scale = dice_.Uniform(0.2, 2.0);
    return place + Step(scale * std::sqrt(-2.0 * std::log(1.0 - dice_.Uniform(0.0, 1.0))));
  }

  // A move with the density of MovePrior, the length of which is chi of four degrees of freedom.
  Eigen::Vector2d MovedAsPrior(const Eigen::Vector2d& place) {
    if (!dice_.Coin(prior_.near_share)) return Anywhere();
    const double sd = prior_.near_sd_m[Integer(0, prior_.near_sd_m.size() - 1)];
    return place + Step(sd * std::hypot(dice_.Normal2().norm(), dice_.Normal2().norm()));
  }

  // The first ones, as large a share as is said.
  void MoveAnyOf(const std::vector<std::size_t>& order, double share) {
    const auto count =
        static_cast<std::size_t>(std::lround(share * static_cast<double>(order.size())));
    for (std::size_t i = 0; i < count; ++i) {
      after_[order[i]] = Moved(before_[order[i]]);
    }
    moved_ += count;
  }

  void MoveBody(const std::vector<std::size_t>& body,
                const Eigen::Vector2d& from,
                const Eigen::Vector2d& to,
                double turn) {
    const Eigen::Matrix2d R = Se2(0.0, 0.0, turn).Rotation();
    for (const std::size_t i : body) after_[i] = to + R * (before_[i] - from);
  }

  void DrawPrior(std::size_t count) {
    scale_sd_ = prior_.sd_scale;
    const Body body = dice_.Coin(prior_.group_share) ? PlaceBody(count) : Body();
    Scatter(count);
    // What moves as one: a body if it does not fall apart, and each other landmark.
    std::vector<std::vector<std::size_t>> units;
    if (body.size > 0 && !dice_.Coin(prior_.body_apart)) {
      units.emplace_back(body.size);
      std::iota(units.back().begin(), units.back().end(), 0U);
    }
    for (std::size_t i = units.empty() ? 0 : body.size; i < count; ++i) units.push_back({i});
    const bool none = dice_.Coin(prior_.none_stayed);
    std::vector<std::size_t> order;
    std::size_t units_that_stay = 0;
    do {
      order = Order(units.size());
      units_that_stay = Integer(0, none ? 1 : units.size());
      moved_ = count;
      for (std::size_t i = 0; i < units_that_stay; ++i) moved_ -= units[order[i]].size();
    } while ((count - moved_ < 2) != none);
    for (std::size_t i = units_that_stay; i < units.size(); ++i) {
      const std::vector<std::size_t>& unit = units[order[i]];
      const Eigen::Vector2d from = before_[unit.front()];
      const bool turns = dice_.Coin(0.5) && (unit.size() == 1 || !body.scattered);
      const double turn = turns ? dice_.Uniform(-kPi, kPi) : 0.2 * dice_.Normal();
      MoveBody(unit, from, MovedAsPrior(from), turn);
    }
  }

  // The first landmarks, which move as one. A scattered body does not turn.
  struct Body {
    std::size_t size = 0;
    bool scattered = false;
  };

  // None if it has more landmarks than there are.
  Body PlaceBody(std::size_t count) {
    Body body{3};
    while (dice_.Coin(prior_.group_continue)) ++body.size;
    if (body.size > count) return {};
    const Eigen::Vector2d centre = Anywhere();
    const double sd = prior_.body_sd_m[Integer(0, prior_.body_sd_m.size() - 1)];
    body.scattered = dice_.Coin(prior_.scattered_share);
    for (std::size_t i = 0; i < body.size; ++i) {
      before_.push_back(body.scattered ? Anywhere() : centre + sd * dice_.Normal2());
    }
    return body;
  }

  void SortByDistance(const Eigen::Vector2d& from, std::vector<std::size_t>* landmarks) {
    std::sort(landmarks->begin(), landmarks->end(), [&](std::size_t i, std::size_t j) {
      return (before_[i] - from).squaredNorm() < (before_[j] - from).squaredNorm();
    });
  }

  void DrawCorner(std::size_t count) {
    Scatter(count);
    std::vector<std::size_t> order = Order(count);
    SortByDistance(Eigen::Vector2d::Zero(), &order);
    const std::size_t stayed = std::min(count - 1, Integer(2, 6));
    order.erase(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(stayed));
    MoveAnyOf(order, 1.0);
  }

  void DrawSymmetric(std::size_t count) {
    const std::size_t columns =
        dice_.Coin(0.5)
            ? (count + 1) / 2
            : static_cast<std::size_t>(std::ceil(std::sqrt(static_cast<double>(count))));
    constexpr double kLeastSpacing = 0.8;  // [m]
    const double spacing = std::max(kLeastSpacing, side_ / static_cast<double>(columns));
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t row = i / columns;
      before_.emplace_back(spacing * static_cast<double>(i % columns),
                           spacing * static_cast<double>(row));
    }
    after_ = before_;
    const std::vector<std::size_t> order = Order(count);
    MoveAnyOf(order, dice_.Uniform(0.1, 1.0));
    const std::size_t exchanged = moved_ / 2;
    if (exchanged < 2) return;
    for (std::size_t i = 0; i < exchanged; ++i) {
      after_[order[i]] = before_[order[(i + 1) % exchanged]];
    }
  }

  void DrawRacks(std::size_t count, std::size_t racks) {
    std::vector<Eigen::Vector2d> centres;
    std::vector<std::vector<std::size_t>> bodies(racks);
    for (std::vector<std::size_t>& body : bodies) {
      centres.push_back(ApartFrom(centres));
      const std::size_t size = Integer(3, 6);
      for (std::size_t i = 0; i < size; ++i) {
        body.push_back(before_.size());
        const double x = kRackSide * dice_.Uniform(-0.5, 0.5);
        const double y = kRackSide * dice_.Uniform(-0.5, 0.5);
        before_.push_back(centres.back() + Eigen::Vector2d(x, y));
      }
    }
    constexpr std::size_t kBeside = 4;
    const std::size_t in_racks = before_.size();
    Scatter(std::max(count, in_racks + kBeside));
    std::vector<std::size_t> order = Order(before_.size());
    order.erase(
        std::remove_if(order.begin(), order.end(), [&](std::size_t i) { return i < in_racks; }),
        order.end());
    MoveAnyOf(order, dice_.Uniform(0.0, 1.0));
    moved_ += in_racks;
    if (racks == 2) {
      for (const std::size_t rack : {0U, 1U}) {
        MoveBody(bodies[rack], centres[rack], centres[1 - rack], dice_.Coin(0.5) ? 0.0 : kPi);
      }
    } else {
      const double turn = dice_.Coin(0.5) ? 0.0 : dice_.Uniform(-kPi, kPi);
      MoveBody(bodies[0], centres[0], Moved(centres[0]), turn);
    }
  }

  void DrawReturns(std::size_t count) {
    Scatter(count);
    MoveAnyOf(Order(count), dice_.Uniform(0.1, 1.0));
    for (std::size_t i = 0; i < count; ++i) {
      const bool moved = after_[i] != before_[i];
      const std::size_t others = Integer(0, 3);
      for (std::size_t k = 0; k < others; ++k) {
        others_.push_back({i, Moved(before_[i])});
      }
      if (!moved || others == 0 || dice_.Coin(0.5)) continue;
      after_[i] = others_[others_.size() - Integer(1, others)].place;
      --moved_;
    }
  }

  // Racks do not overlap.
  Eigen::Vector2d ApartFrom(const std::vector<Eigen::Vector2d>& others) {
    Eigen::Vector2d place;
    do {
      place = Anywhere();
    } while (std::any_of(others.begin(), others.end(), [&](const Eigen::Vector2d& other) {
      return (place - other).norm() < 1.5 * kRackSide;
    }));
    return place;
  }

  AlignmentPair Finish() {
    AlignmentPair pair;
    pair.places = before_;
    pair.stayed = static_cast<int>(before_.size() - moved_);
    std::vector<int> groups(before_.size());
    std::iota(groups.begin(), groups.end(), 0);
    std::vector<int> groups_of_places = groups;
    for (const OtherPlace& other : others_) {
      pair.places.push_back(other.place);
      groups_of_places.push_back(static_cast<int>(other.landmark));
    }
    pair.reference = DrawMap(pair.places, groups_of_places, &dice_);
    pair.other = DrawMap(after_, groups, &dice_);
    const bool prior = world_ == AlignmentWorld::kPrior;
    pair.area_m2 = prior ? side_ * side_ : OccupiedArea(PositionsOf(pair.reference.points));
    pair.sd_scale = scale_sd_;
    pair.scale = std::exp(scale_sd_ * dice_.Normal());
    constexpr double kAway = 10.0;  // [m]
    const Eigen::Vector2d translation = kAway * dice_.Normal2();
    pair.T_other_reference = Se2(translation, dice_.Uniform(-kPi, kPi));
    Transform(pair.T_other_reference, pair.scale, &pair.other);
    return pair;
  }

  // Where a landmark stood at another time.
  struct OtherPlace {
    std::size_t landmark = 0;
    Eigen::Vector2d place;
  };

  AlignmentWorld world_;
  MovePrior prior_;
  Dice dice_;
  double side_;  // Of the site. [m]
  double scale_sd_ = 0.0;
  std::vector<Eigen::Vector2d> before_;
  std::vector<OtherPlace> others_;
  std::vector<Eigen::Vector2d> after_;
  std::size_t moved_ = 0;
};

}  // namespace

const char* ToString(AlignmentWorld world) {
  switch (world) {
    case AlignmentWorld::kPrior:
      return "prior";
    case AlignmentWorld::kSpread:
      return "spread";
    case AlignmentWorld::kCorner:
      return "corner";
    case AlignmentWorld::kSymmetric:
      return "symmetric";
    case AlignmentWorld::kSwappedRacks:
      return "swapped-racks";
    case AlignmentWorld::kRackMoved:
      return "rack-moved";
    case AlignmentWorld::kNone:
      return "none";
    case AlignmentWorld::kReturns:
      return "returns";
  }
  return "";
}

bool AlignmentPair::IsRight(const Alignment& alignment, double tolerance_m) const {
  const Eigen::Matrix2d R = T_other_reference.Rotation();
  const Eigen::Vector2d& centre = alignment.centroid;
  const Eigen::Vector2d centre_other = T_other_reference.translation() + scale * (R * centre);
  return std::all_of(places.begin(), places.end(), [&](const Eigen::Vector2d& place) {
    const Eigen::Vector2d p_other = centre_other + R * (place - centre);
    return (alignment.T_reference_other * p_other - place).norm() < tolerance_m;
  });
}

AlignmentPair DrawAlignmentPair(AlignmentWorld world, std::uint64_t seed) {
  return PairDraw(world, seed * kAlignmentWorlds + static_cast<std::uint64_t>(world)).Draw();
}

}  // namespace shiftmap
