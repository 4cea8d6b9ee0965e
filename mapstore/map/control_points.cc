// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/control_points.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "mapstore/core/inert_text.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/map/frame_change.h"

namespace shiftmap {
namespace {

// Points that know the rotation less well than this do not tell it.
constexpr double kMaxRotationSd = 0.05;  // [rad]

// So many honest surveys are refused of a map whose errors have so many times the variance that its
// covariance says.
constexpr double kFalseRefusals = 1e-4;
constexpr double kVarianceRatio = 1.5;

// A control point and where the map has its mode.
struct HeldMode {
  int index = 0;  // In the map's covariance.
  const ControlPoint* point = nullptr;
  Eigen::Vector2d p = Eigen::Vector2d::Zero();
  Eigen::Vector2d target = Eigen::Vector2d::Zero();
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
        held.push_back(
            {first + state - 1, &point, mode.p_map_landmark, point.p_map_landmark, 1.0 / variance});
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

// @param yaw_rad  If the points do not tell it.
FirstGuess AlignRigidly(const std::vector<HeldMode>& held, double yaw_rad = 0.0) {
  double weight = 0.0;
  Eigen::Vector2d from = Eigen::Vector2d::Zero();
  Eigen::Vector2d to = Eigen::Vector2d::Zero();
  for (const HeldMode& mode : held) {
    weight += mode.weight;
    from += mode.weight * mode.p;
    to += mode.weight * mode.target;
  }
  from /= weight;
  to /= weight;
  double dot = 0.0;
  double cross = 0.0;
  double lever = 0.0;
  for (const HeldMode& mode : held) {
    const Eigen::Vector2d a = mode.p - from;
    const Eigen::Vector2d b = mode.target - to;
    dot += mode.weight * a.dot(b);
    cross += mode.weight * (a.x() * b.y() - a.y() * b.x());
    lever += mode.weight * a.squaredNorm();
  }
  FirstGuess guess;
  guess.turns = lever * kMaxRotationSd * kMaxRotationSd > 1.0;
  const double yaw = guess.turns ? std::atan2(cross, dot) : yaw_rad;
  const Se2 rotation(0.0, 0.0, yaw);
  guess.T_new_old = Se2(to - rotation * from, yaw);
  return guess;
}

// The points' residuals, their covariance, and what a small motion of the frame does to them.
struct Residuals {
  Eigen::MatrixXd M;
  Eigen::MatrixXd G;
  Eigen::VectorXd r;
};

Residuals ResidualsOf(const std::vector<HeldMode>& held,
                      bool turns,
                      const JointCovariance& covariance) {
  const auto rows = static_cast<Eigen::Index>(2 * held.size());
  Residuals of{Eigen::MatrixXd(rows, rows),
               Eigen::MatrixXd::Zero(rows, turns ? 3 : 2),
               Eigen::VectorXd(rows)};
  for (std::size_t i = 0; i < held.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(2 * i);
    const Eigen::Vector2d& p = held[i].p;
    for (std::size_t k = 0; k < held.size(); ++k) {
      of.M.block<2, 2>(row, static_cast<Eigen::Index>(2 * k)) =
          covariance.Block(held[i].index, held[k].index);
    }
    of.M.block<2, 2>(row, row).diagonal().array() += held[i].point->sd_m * held[i].point->sd_m;
    of.G.block<2, 2>(row, 0).setIdentity();
    if (turns) of.G.block<2, 1>(row, 2) << -p.y(), p.x();
    of.r.segment<2>(row) = held[i].target - p;
  }
  return of;
}

// rᵀ Q r of the points, in the map's own frame, and its degrees of freedom.
struct Misfit {
  double chi_square = 0.0;
  int dof = 0;
  bool turns = false;  // The frame's rotation is free.
};

Misfit MisfitOf(std::vector<HeldMode> held, const JointCovariance& covariance) {
  if (held.size() < 2) return {};
  const FirstGuess guess = AlignRigidly(held);
  const Se2 T_old_new = guess.T_new_old.Inverse();
  for (HeldMode& mode : held) mode.target = T_old_new * mode.target;
  const auto [M, G, r] = ResidualsOf(held, guess.turns, covariance);
  const Eigen::LDLT<Eigen::MatrixXd> inverse(M);
  const Eigen::MatrixXd MG = inverse.solve(G);
  const Eigen::VectorXd f = (G.transpose() * MG).ldlt().solve(MG.transpose() * r);
  return {r.dot(inverse.solve(r - G * f)), static_cast<int>(G.rows() - G.cols()), guess.turns};
}

// The point without which the others fit best; of equal ones the last, which came last.
std::size_t FindWorst(const std::vector<HeldMode>& held, const JointCovariance& covariance) {
  std::size_t worst = 0;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < held.size(); ++i) {
    std::vector<HeldMode> others = held;
    others.erase(others.begin() + static_cast<std::ptrdiff_t>(i));
    const double left = MisfitOf(std::move(others), covariance).chi_square;
    if (left > least) continue;
    least = left;
    worst = i;
  }
  return worst;
}

// How far a point is from where the others put its mode. [m]
double DistanceFromOthers(std::vector<HeldMode> held, std::size_t i) {
  const HeldMode mode = held[i];
  const double yaw = AlignRigidly(held).T_new_old.yaw();
  held.erase(held.begin() + static_cast<std::ptrdiff_t>(i));
  return (mode.target - AlignRigidly(held, yaw).T_new_old * mode.p).norm();
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

Status CheckControlPoints(const std::vector<ControlPoint>& points, const MapContent& content) {
  const std::vector<HeldMode> held = FindModes(points, content);
  const Misfit misfit = MisfitOf(held, content.covariance);
  if (misfit.dof < 1) return OkStatus();
  const double bound = kVarianceRatio * ChiSquareQuantile(1.0 - kFalseRefusals, misfit.dof);
  if (!(misfit.chi_square > bound)) return OkStatus();
  const std::size_t worst = FindWorst(held, content.covariance);
  return InvalidArgument(
      "control point '{}': {:.3f} m from where the map and the other control points put it (chi "
      "square {:.4g}, expected at most {:.4g}): correct it, {}",
      InertLine(held[worst].point->signature.text()),
      DistanceFromOthers(held, worst),
      misfit.chi_square,
      bound,
      misfit.turns ? "undo its edit, or state a larger sd"
                   : "or begin with points farther apart, which tell how the frame is turned");
}

Se2 HoldControlPoints(const std::vector<ControlPoint>& points, bool inform, MapContent* content) {
  std::vector<HeldMode> held = FindModes(points, *content);
  if (held.empty()) return {};
  const FirstGuess guess = AlignRigidly(held);
  MoveContent(guess.T_new_old, content);
  if (held.size() < 2) return guess.T_new_old;

  for (HeldMode& mode : held) mode.p = guess.T_new_old * mode.p;
  const auto [M, G, r] = ResidualsOf(held, guess.turns, content->covariance);
  const std::vector<Mode*> modes = ModesOf(content);
  Eigen::MatrixXd L(static_cast<Eigen::Index>(2 * modes.size()), M.rows());
  for (std::size_t i = 0; i < held.size(); ++i) {
    for (int mode = 0; mode < content->covariance.size(); ++mode) {
      L.block<2, 2>(Eigen::Index{2} * mode, static_cast<Eigen::Index>(2 * i)) =
          content->covariance.Block(mode, held[i].index);
    }
  }
  const Eigen::LDLT<Eigen::MatrixXd> inverse(M);
  const Eigen::MatrixXd MG = inverse.solve(G);
  const Eigen::LDLT<Eigen::MatrixXd> frame(G.transpose() * MG);
  const Eigen::MatrixXd Q = inverse.solve(Eigen::MatrixXd::Identity(M.rows(), M.rows())) -
                            MG * frame.solve(MG.transpose());
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
