// SPDX-License-Identifier: Apache-2.0
#include "localizer/models/scan_polygon.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

namespace shiftmap {
namespace {

double Cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

// L with L Lᵀ = cov, also for a singular one.
template <int kSize>
Eigen::Matrix<double, kSize, kSize> SquareRoot(const Eigen::Matrix<double, kSize, kSize>& cov) {
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, kSize, kSize>> solver;
  solver.computeDirect(cov);
  return solver.eigenvectors() * solver.eigenvalues().cwiseMax(0.0).cwiseSqrt().asDiagonal();
}

}  // namespace

ScanPolygon::ScanPolygon(std::span<const Eigen::Vector2d> border_lidar,
                         const Se2& T_vehicle_lidar,
                         bool all_round,
                         double grown_m)
    : T_lidar_vehicle_(T_vehicle_lidar.Inverse()) {
  for (const Eigen::Vector2d& p : border_lidar) {
    border_.push_back(p + grown_m * p.normalized());
    bearings_.push_back(std::atan2(p.y(), p.x()));
  }
  if (!all_round || border_.size() < 3) return;
  // Once around: the last point before the first, and the first behind the last.
  border_.insert(border_.begin(), border_.back());
  bearings_.insert(bearings_.begin(), bearings_.back() - 2.0 * std::numbers::pi);
  border_.push_back(border_[1]);
  bearings_.push_back(bearings_[1] + 2.0 * std::numbers::pi);
}

bool ScanPolygon::Contains(const Eigen::Vector2d& p_vehicle) const {
  if (border_.size() < 2) return false;
  const Eigen::Vector2d q = T_lidar_vehicle_ * p_vehicle;
  const double bearing = std::atan2(q.y(), q.x());
  if (!(bearing >= bearings_.front() && bearing <= bearings_.back())) return false;
  // The triangle between two beams: q is on the lidar's side of the border from a to b.
  const auto next = std::upper_bound(bearings_.begin() + 1, bearings_.end() - 1, bearing);
  const auto i = static_cast<std::size_t>(next - bearings_.begin());
  const Eigen::Vector2d& a = border_[i - 1];
  const Eigen::Vector2d& b = border_[i];
  return Cross(b - a, q - a) >= 0.0;
}

ScanPolygonFieldOfView::ScanPolygonFieldOfView(const ScanPolygonOptions& options) {
  std::mt19937_64 random(options.seed);
  std::normal_distribution<double> normal;
  draws_.resize(static_cast<std::size_t>(options.samples));
  for (auto& draw : draws_) {
    for (double& value : draw) value = normal(random);
  }
}

double ScanPolygonFieldOfView::operator()(const ScanPolygon& polygon,
                                          const PoseWithCovariance& pose,
                                          const Eigen::Vector2d& p_map_landmark,
                                          const Eigen::Matrix2d& cov_p_map_landmark) const {
  const Eigen::Matrix3d L_pose = SquareRoot<3>(pose.cov_T_map_vehicle);
  const Eigen::Matrix2d L_landmark = SquareRoot<2>(cov_p_map_landmark);
  const Se2 T_vehicle_map = pose.T_map_vehicle.Inverse();
  const Eigen::Vector2d q = T_vehicle_map * p_map_landmark;
  const Eigen::Matrix2d L_q = T_vehicle_map.Rotation() * L_landmark;
  int inside = 0;
  for (const auto& draw : draws_) {
    // (T Exp(ξ))⁻¹ p = Exp(-ξ) T⁻¹ p.
    const Se2 T_sample_vehicle = Se2::Exp(-(L_pose * draw.head<3>()));
    if (polygon.Contains(T_sample_vehicle * (q + L_q * draw.tail<2>()))) ++inside;
  }
  return static_cast<double>(inside) / static_cast<double>(draws_.size());
}

}  // namespace shiftmap
