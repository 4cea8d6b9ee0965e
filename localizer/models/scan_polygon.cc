// SPDX-License-Identifier: Apache-2.0
#include "localizer/models/scan_polygon.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

namespace shiftmap {
namespace {

constexpr double kFullTurn = 2.0 * std::numbers::pi;

double Cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

}  // namespace

ScanPolygon::ScanPolygon(std::span<const Eigen::Vector2d> border_lidar,
                         const Se2& T_vehicle_lidar,
                         bool all_round,
                         double grown_m)
    : T_lidar_vehicle_(T_vehicle_lidar.Inverse()), T_lidar_now_(T_lidar_vehicle_) {
  for (const Eigen::Vector2d& p : border_lidar) {
    Add(std::atan2(p.y(), p.x()), p + grown_m * p.normalized());
  }
  if (all_round && border_.size() >= 3) Close();
}

void ScanPolygon::Assign(const LidarScan& scan, double grown_m) {
  const std::size_t beams = scan.ranges_m.size();
  T_lidar_vehicle_ = scan.sensor.T_vehicle_lidar.Inverse();
  T_lidar_now_ = T_lidar_vehicle_;
  border_.clear();
  bearings_.clear();
  for (std::size_t beam = 0; beam < beams; ++beam) {
    const double bearing = scan.sensor.Bearing(beam, beams);
    const auto measured = static_cast<double>(scan.ranges_m[beam]);
    const double range =
        grown_m + (scan.sensor.Returned(measured) ? measured : scan.sensor.max_range_m);
    Add(bearing, {range * std::cos(bearing), range * std::sin(bearing)});
  }
  if (scan.sensor.AllRound(beams)) Close();
}

void ScanPolygon::Add(double bearing_rad, const Eigen::Vector2d& p_lidar) {
  border_.push_back(p_lidar);
  bearings_.push_back(bearing_rad);
}

void ScanPolygon::Close() {
  // The last point before the first, and the first behind the last.
  border_.insert(border_.begin(), border_.back());
  bearings_.insert(bearings_.begin(), bearings_.back() - kFullTurn);
  Add(bearings_[1] + kFullTurn, border_[1]);
}

std::size_t ScanPolygon::Next(double bearing_rad) const {
  const auto next = std::upper_bound(bearings_.begin() + 1, bearings_.end() - 1, bearing_rad);
  return static_cast<std::size_t>(next - bearings_.begin());
}

bool ScanPolygon::Contains(const Eigen::Vector2d& p_vehicle) const {
  if (border_.size() < 2) return false;
  const Eigen::Vector2d q = T_lidar_now_ * p_vehicle;
  const double bearing = std::atan2(q.y(), q.x());
  if (!(bearing >= bearings_.front() && bearing <= bearings_.back())) return false;
  // The triangle between two beams: q is on the lidar's side of the border from a to b.
  const std::size_t next = Next(bearing);
  const Eigen::Vector2d& a = border_[next - 1];
  const Eigen::Vector2d& b = border_[next];
  return Cross(b - a, q - a) >= 0.0;
}

std::optional<bool> ScanPolygon::ContainsDisc(const Eigen::Vector2d& p_vehicle,
                                              double radius_m) const {
  if (border_.size() < 2) return false;
  const Eigen::Vector2d q = T_lidar_now_ * p_vehicle;
  const double range = q.norm();
  if (!(radius_m < range)) return std::nullopt;
  const double bearing = std::atan2(q.y(), q.x());
  const double half = std::asin(radius_m / range);
  const double front = bearings_.front();
  const double back = bearings_.back();
  if (bearing - half < front || bearing + half > back) {
    const bool behind = (bearing + half < front && bearing - half + kFullTurn > back) ||
                        (bearing - half > back && bearing + half - kFullTurn < front);
    return behind ? std::optional(false) : std::nullopt;
  }
  bool inside = true;
  bool outside = true;
  const std::size_t last = Next(bearing + half);
  for (std::size_t next = Next(bearing - half); next <= last; ++next) {
    const double a = border_[next - 1].norm();
    const double b = border_[next].norm();
    // The border between two beams δ apart is no nearer than min(a, b) cos(δ/2).
    const double step = bearings_[next] - bearings_[next - 1];
    inside = inside && range + radius_m < std::min(a, b) * (1.0 - 0.125 * step * step);
    outside = outside && range - radius_m > std::max(a, b);
  }
  if (inside) return true;
  return outside ? std::optional(false) : std::nullopt;
}

ScanPolygonShare::ScanPolygonShare(const ScanPolygonOptions& options) {
  std::mt19937_64 random(options.seed);
  std::normal_distribution<double> normal;
  draws_.resize(static_cast<std::size_t>(options.samples));
  for (Eigen::Vector2d& draw : draws_) {
    draw.x() = normal(random);
    draw.y() = normal(random);
    longest_draw_ = std::max(longest_draw_, draw.norm());
  }
}

double ScanPolygonShare::operator()(const ScanPolygon& polygon,
                                    const Eigen::Vector2d& q,
                                    const Eigen::Matrix2d& cov_q) const {
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> solver;
  solver.computeDirect(cov_q);
  const Eigen::Vector2d sd = solver.eigenvalues().cwiseMax(0.0).cwiseSqrt();
  // Most landmarks are far from the border, and all their samples on one side of it.
  constexpr double kRounding = 1e-9;  // Of radii, and in metres.
  const double radius_m = (1.0 + kRounding) * longest_draw_ * sd.maxCoeff() + kRounding;
  if (const auto plain = polygon.ContainsDisc(q, radius_m)) return *plain ? 1.0 : 0.0;
  const Eigen::Matrix2d L = solver.eigenvectors() * sd.asDiagonal();
  int inside = 0;
  for (const Eigen::Vector2d& draw : draws_) {
    if (polygon.Contains(q + L * draw)) ++inside;
  }
  return static_cast<double>(inside) / static_cast<double>(draws_.size());
}

}  // namespace shiftmap
