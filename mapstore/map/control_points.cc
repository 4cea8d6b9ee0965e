// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/control_points.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

#include "mapstore/map/frame_change.h"

namespace shiftmap {
namespace {

// Points that know the rotation less well than this do not tell it.
constexpr double kMaxRotationSd = 0.05;  // [rad]

// A control point and where the map has its mode.
struct HeldMode {
  int index = 0;  // In the map's covariance.
  const ControlPoint* point = nullptr;
  Eigen::Vector2d p = Eigen::Vector2d::Zero();
  double weight = 0.0;  // Of the first guess of the frame. [1/m²]
};

std::vector<HeldMode> FindModes(const std::vector<ControlPoint>& points,
                                const MapContent& content) {
  std::vector<HeldMode> held;
  for (const ControlPoint& point : points) {
    int first = 0;
    for (const LandmarkGroup& group : content.groups) {
      const int state = group.signature == point.signature ? group.CarriedStateOf(point.mode) : -1;
      if (state > 0) {
        const Mode& mode = group.modes[static_cast<std::size_t>(state) - 1];
        const double variance = point.sd_m * point.sd_m + 0.5 * mode.cov_p_map_landmark.trace();
        held.push_back({first + state - 1, &point, mode.p_map_landmark, 1.0 / variance});
      }
      first += static_cast<int>(group.modes.size());
    }
  }
  return held;
}

// Weighted least squares over rigid motions.
struct FirstGuess {
  Se2 T_new_old;
  bool turns = false;
};

FirstGuess AlignRigidly(const std::vector<HeldMode>& held) {
  double weight = 0.0;
  Eigen::Vector2d from = Eigen::Vector2d::Zero();
  Eigen::Vector2d to = Eigen::Vector2d::Zero();
  for (const HeldMode& mode : held) {
    weight += mode.weight;
    from += mode.weight * mode.p;
    to += mode.weight * mode.point->p_map_landmark;
  }
  from /= weight;
  to /= weight;
  double dot = 0.0;
  double cross = 0.0;
  double lever = 0.0;
  for (const HeldMode& mode : held) {
    const Eigen::Vector2d a = mode.p - from;
    const Eigen::Vector2d b = mode.point->p_map_landmark - to;
    dot += mode.weight * a.dot(b);
    cross += mode.weight * (a.x() * b.y() - a.y() * b.x());
    lever += mode.weight * a.squaredNorm();
  }
  FirstGuess guess;
  guess.turns = lever * kMaxRotationSd * kMaxRotationSd > 1.0;
  const double yaw = guess.turns ? std::atan2(cross, dot) : 0.0;
  const Se2 rotation(0.0, 0.0, yaw);
  guess.T_new_old = Se2(to - rotation * from, yaw);
  return guess;
}

std::vector<Mode*> ModesOf(MapContent* content) {
  std::vector<Mode*> modes;
  for (LandmarkGroup& group : content->groups) {
    for (Mode& mode : group.modes) modes.push_back(&mode);
  }
  return modes;
}

// P' = P - L Q Lᵀ with L = P Hᵀ, of every stored block.
void Inform(const Eigen::MatrixXd& L, const Eigen::MatrixXd& Q, MapContent* content) {
  const Eigen::MatrixXd LQ = L * Q;
  const auto block = [&](int a, int b) -> Eigen::Matrix2d {
    return LQ.middleRows<2>(Eigen::Index{2} * a) * L.middleRows<2>(Eigen::Index{2} * b).transpose();
  };
  const std::vector<Mode*> modes = ModesOf(content);
  std::vector<Eigen::Matrix2d> diagonal;
  for (int i = 0; i < content->covariance.size(); ++i) {
    const Eigen::Matrix2d value = content->covariance.Block(i, i) - block(i, i);
    diagonal.emplace_back(0.5 * (value + value.transpose()));
    modes[static_cast<std::size_t>(i)]->cov_p_map_landmark = diagonal.back();
  }
  std::vector<JointCovariance::CrossBlock> cross = content->covariance.cross_blocks();
  for (JointCovariance::CrossBlock& of : cross) of.value -= block(of.row, of.column);
  content->covariance = JointCovariance(std::move(diagonal), std::move(cross));
}

// Whether every mode is told together with every other: what is stored of a larger map's covariance
// would not stay one.
bool IsDense(const JointCovariance& cov) {
  const auto size = static_cast<std::size_t>(cov.size());
  return cov.cross_blocks().size() == size * (size - 1) / 2;
}

}  // namespace

Se2 HoldControlPoints(const std::vector<ControlPoint>& points, bool inform, MapContent* content) {
  std::vector<HeldMode> held = FindModes(points, *content);
  if (held.empty()) return {};
  const FirstGuess guess = AlignRigidly(held);
  MoveContent(guess.T_new_old, content);
  if (held.size() < 2) return guess.T_new_old;

  const auto rows = static_cast<Eigen::Index>(2 * held.size());
  const std::vector<Mode*> modes = ModesOf(content);
  Eigen::MatrixXd M(rows, rows);
  Eigen::MatrixXd G = Eigen::MatrixXd::Zero(rows, guess.turns ? 3 : 2);
  Eigen::MatrixXd L(static_cast<Eigen::Index>(2 * modes.size()), rows);
  Eigen::VectorXd r(rows);
  for (std::size_t i = 0; i < held.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(2 * i);
    const Eigen::Vector2d p = guess.T_new_old * held[i].p;
    for (std::size_t k = 0; k < held.size(); ++k) {
      M.block<2, 2>(row, static_cast<Eigen::Index>(2 * k)) =
          content->covariance.Block(held[i].index, held[k].index);
    }
    M.block<2, 2>(row, row).diagonal().array() += held[i].point->sd_m * held[i].point->sd_m;
    G.block<2, 2>(row, 0).setIdentity();
    if (guess.turns) G.block<2, 1>(row, 2) << -p.y(), p.x();
    r.segment<2>(row) = held[i].point->p_map_landmark - p;
    for (int mode = 0; mode < content->covariance.size(); ++mode) {
      L.block<2, 2>(Eigen::Index{2} * mode, row) = content->covariance.Block(mode, held[i].index);
    }
  }
  const Eigen::LDLT<Eigen::MatrixXd> inverse(M);
  const Eigen::MatrixXd MG = inverse.solve(G);
  const Eigen::LDLT<Eigen::MatrixXd> frame(G.transpose() * MG);
  const Eigen::MatrixXd Q =
      inverse.solve(Eigen::MatrixXd::Identity(rows, rows)) - MG * frame.solve(MG.transpose());
  const Eigen::VectorXd f = frame.solve(MG.transpose() * r);
  const Eigen::VectorXd shape = L * (Q * r);
  if (!f.allFinite() || !shape.allFinite()) return guess.T_new_old;

  for (std::size_t i = 0; i < modes.size(); ++i) {
    modes[i]->p_map_landmark += shape.segment<2>(static_cast<Eigen::Index>(2 * i));
  }
  if (inform && IsDense(content->covariance)) Inform(L, Q, content);
  const Se2 rest(f.head<2>(), guess.turns ? f(2) : 0.0);
  MoveContent(rest, content);
  return rest * guess.T_new_old;
}

}  // namespace shiftmap
