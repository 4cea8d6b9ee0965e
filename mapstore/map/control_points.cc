// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/control_points.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
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

// Whether the map's covariance tells every mode together with every other, so that it can know of
// control points: a block that is not stored is zero then.
bool IsJoint(const MapContent& content) { return content.covariance.size() <= kMaxJointModes; }

// A control point and where the map has its mode.
struct HeldMode {
  int index = 0;  // In the map's covariance.
  const ControlPoint* point = nullptr;
  Eigen::Vector2d p = Eigen::Vector2d::Zero();
  Eigen::Vector2d target = Eigen::Vector2d::Zero();
  double weight = 0.0;  // 1 / sd² [1/m²]
  bool known = false;   // To the map's covariance.
};

// @param known  So many points, the first, are known.
std::vector<HeldMode> FindModes(const std::vector<ControlPoint>& points,
                                std::size_t known,
                                const MapContent& content) {
  if (!IsJoint(content)) known = 0;
  std::vector<HeldMode> held;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const ControlPoint& point = points[i];
    int first = 0;
    for (const LandmarkGroup& group : content.groups) {
      const int state = group.signature == point.signature ? group.CarriedStateOf(point.mode) : -1;
      if (state > 0) {
        held.push_back({first + state - 1,
                        &point,
                        group.modes[static_cast<std::size_t>(state) - 1].p_map_landmark,
                        point.p_map_landmark,
                        1.0 / (point.sd_m * point.sd_m),
                        i < known});
      }
      first += static_cast<int>(group.modes.size());
    }
  }
  return held;
}

// Weighted least squares over rigid motions: the frame of modes that are where the map has them.
struct Frame {
  Se2 T_new_old;
  bool turns = false;
};

// @param yaw_rad  If the points do not tell it.
Frame AlignRigidly(const std::vector<HeldMode>& held, double yaw_rad = 0.0) {
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
  Frame frame;
  frame.turns = lever * kMaxRotationSd * kMaxRotationSd > 1.0;
  const double yaw = frame.turns ? std::atan2(cross, dot) : yaw_rad;
  const Se2 rotation(0.0, 0.0, yaw);
  frame.T_new_old = Se2(to - rotation * from, yaw);
  return frame;
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
  const Frame guess = AlignRigidly(held);
  const Se2 T_old_new = guess.T_new_old.Inverse();
  for (HeldMode& mode : held) mode.target = T_old_new * mode.target;
  const auto [M, G, r] = ResidualsOf(held, guess.turns, covariance);
  const Eigen::LDLT<Eigen::MatrixXd> inverse(M);
  const Eigen::MatrixXd MG = inverse.solve(G);
  const Eigen::VectorXd f = (G.transpose() * MG).ldlt().solve(MG.transpose() * r);
  return {r.dot(inverse.solve(r - G * f)), static_cast<int>(G.rows() - G.cols()), guess.turns};
}

double BoundOf(const Misfit& misfit) {
  return kVarianceRatio * ChiSquareQuantile(1.0 - kFalseRefusals, misfit.dof);
}

bool Fits(const Misfit& misfit) { return misfit.dof < 1 || misfit.chi_square <= BoundOf(misfit); }

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

// W = R⁻¹ - R⁻¹G (GᵀR⁻¹G)⁻¹ GᵀR⁻¹, the information of points about the modes' shape, R = diag(sd²);
// zero for other points.
// @param turns  The frame's rotation is free.
Eigen::MatrixXd InformationOf(const std::vector<HeldMode>& held, bool known_only, bool turns) {
  const auto rows = static_cast<Eigen::Index>(2 * held.size());
  Eigen::VectorXd weights(rows);
  Eigen::MatrixXd G = Eigen::MatrixXd::Zero(rows, turns ? 3 : 2);
  for (std::size_t i = 0; i < held.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(2 * i);
    const Eigen::Vector2d offset = held[i].p - held.front().p;
    weights.segment<2>(row).setConstant(known_only && !held[i].known ? 0.0 : held[i].weight);
    G.block<2, 2>(row, 0).setIdentity();
    if (turns) G.block<2, 1>(row, 2) << -offset.y(), offset.x();
  }
  Eigen::MatrixXd W = weights.asDiagonal();
  if (weights.isZero(0.0)) return W;
  const Eigen::MatrixXd WG = weights.asDiagonal() * G;
  W -= WG * (G.transpose() * WG).ldlt().solve(WG.transpose());
  return W;
}

// P' = P - L Q Lᵀ.
void Inform(const Eigen::MatrixXd& L, const Eigen::MatrixXd& Q, MapContent* content) {
  const Eigen::MatrixXd P = content->covariance.Dense() - L * Q * L.transpose();
  content->covariance = JointCovariance::FromDense(0.5 * (P + P.transpose()));
  const std::vector<Mode*> modes = ModesOf(content);
  for (int i = 0; i < content->covariance.size(); ++i) {
    modes[static_cast<std::size_t>(i)]->cov_p_map_landmark = content->covariance.Block(i, i);
  }
}

// Conditions the modes' shape on the points that the map does not know of, in the map's own frame.
// What it knows of the others is taken from what all say together:
//   D = W - W_known,  Q = (I + D S)⁻¹ D,  Δ = P Hᵀ (I + D S)⁻¹ (W r - W_known r_known)
// @return T_new_old of the frame.
Se2 ConditionShape(std::vector<HeldMode> held, MapContent* content) {
  constexpr int kRounds = 5;  // The frame and the shape take turns, each where the other says.
  std::vector<HeldMode> known = held;
  std::erase_if(known, [](const HeldMode& mode) { return !mode.known; });
  const auto rows = static_cast<Eigen::Index>(2 * held.size());
  const int modes = content->covariance.size();
  Eigen::MatrixXd L(Eigen::Index{2} * modes, rows);
  Eigen::MatrixXd S(rows, rows);
  Eigen::VectorXd before(rows);
  Eigen::VectorXd r_known(rows);
  for (std::size_t i = 0; i < held.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(2 * i);
    for (int mode = 0; mode < modes; ++mode) {
      L.block<2, 2>(Eigen::Index{2} * mode, row) = content->covariance.Block(mode, held[i].index);
    }
    before.segment<2>(row) = held[i].p;
    r_known.segment<2>(row) = held[i].target - held[i].p;
  }
  for (std::size_t i = 0; i < held.size(); ++i) {
    S.middleRows<2>(static_cast<Eigen::Index>(2 * i)) =
        L.middleRows<2>(Eigen::Index{2} * held[i].index);
  }
  const Frame rigid = AlignRigidly(held);
  Frame frame = rigid;
  const Eigen::MatrixXd W = InformationOf(held, false, frame.turns);
  const bool turned = !known.empty() && AlignRigidly(known).turns;
  const Eigen::MatrixXd W_known = InformationOf(held, true, turned);
  const Eigen::MatrixXd D = W - W_known;
  const Eigen::PartialPivLU<Eigen::MatrixXd> lu(Eigen::MatrixXd::Identity(rows, rows) + D * S);
  Eigen::VectorXd u = Eigen::VectorXd::Zero(rows);
  for (int round = 0; round < kRounds; ++round) {
    const Se2 T_old_new = frame.T_new_old.Inverse();
    Eigen::VectorXd r(rows);
    for (std::size_t i = 0; i < held.size(); ++i) {
      const auto row = static_cast<Eigen::Index>(2 * i);
      r.segment<2>(row) = T_old_new * held[i].target - before.segment<2>(row);
    }
    u = lu.solve(W * r - W_known * r_known);
    const Eigen::VectorXd moved = before + S * u;
    for (std::size_t i = 0; i < held.size(); ++i) {
      held[i].p = moved.segment<2>(static_cast<Eigen::Index>(2 * i));
    }
    frame = AlignRigidly(held);
  }
  const Eigen::VectorXd shape = L * u;
  if (!shape.allFinite()) return rigid.T_new_old;
  Eigen::Index row = 0;
  for (Mode* const mode : ModesOf(content)) {
    mode->p_map_landmark += shape.segment<2>(row);
    row += 2;
  }
  if (IsJoint(*content)) Inform(L, lu.solve(D), content);
  return frame.T_new_old;
}

}  // namespace

Status CheckControlPoints(const std::vector<ControlPoint>& points, const MapContent& content) {
  const std::vector<HeldMode> held = FindModes(points, 0, content);
  const Misfit misfit = MisfitOf(held, content.covariance);
  if (Fits(misfit)) return OkStatus();
  const std::size_t worst = FindWorst(held, content.covariance);
  return InvalidArgument(
      "control point '{}': {:.3f} m from where the map and the other control points put it (chi "
      "square {:.4g}, expected at most {:.4g}): correct it, {}",
      InertLine(held[worst].point->signature.text()),
      DistanceFromOthers(held, worst),
      misfit.chi_square,
      BoundOf(misfit),
      misfit.turns ? "undo its edit, or state a larger sd"
                   : "or begin with points farther apart, which tell how the frame is turned");
}

std::vector<ControlPoint> FittingControlPoints(const std::vector<ControlPoint>& points,
                                               const MapContent& content) {
  const auto fit = [&](const std::vector<ControlPoint>& some) {
    return Fits(MisfitOf(FindModes(some, 0, content), content.covariance));
  };
  if (fit(points)) return points;
  std::vector<ControlPoint> fitting;
  for (std::size_t i = 0; i < points.size(); ++i) {
    std::vector<ControlPoint> others = points;
    others.erase(others.begin() + static_cast<std::ptrdiff_t>(i));
    if (!fit(others)) continue;
    if (!fitting.empty()) return {};
    fitting = std::move(others);
  }
  return fitting;
}

Se2 HoldControlPoints(const std::vector<ControlPoint>& points,
                      std::size_t known,
                      MapContent* content) {
  const std::vector<HeldMode> held = FindModes(points, known, *content);
  if (held.empty()) return {};
  const bool all_known =
      std::all_of(held.begin(), held.end(), [](const HeldMode& mode) { return mode.known; });
  const Se2 T_new_old = all_known ? AlignRigidly(held).T_new_old : ConditionShape(held, content);
  MoveContent(T_new_old, content);
  return T_new_old;
}

}  // namespace shiftmap
