// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/blob.h"

#include <bit>
#include <cmath>
#include <cstdint>

namespace shiftmap {
namespace {

constexpr std::size_t kNumberBytes = 8;
constexpr std::size_t kPoseBytes = 4 * kNumberBytes;
constexpr std::size_t kModeBytes = 2 * kNumberBytes;

void Append(std::string& bytes, std::int64_t value) {
  const auto bits = static_cast<std::uint64_t>(value);
  for (int shift = 56; shift >= 0; shift -= 8) bytes += static_cast<char>(bits >> shift);
}

void Append(std::string& bytes, double value) { Append(bytes, std::bit_cast<std::int64_t>(value)); }

std::int64_t IntegerAt(std::string_view bytes, std::size_t offset) {
  std::uint64_t bits = 0;
  for (std::size_t i = 0; i < kNumberBytes; ++i) {
    bits = bits << 8 | static_cast<unsigned char>(bytes[offset + i]);
  }
  return static_cast<std::int64_t>(bits);
}

double DoubleAt(std::string_view bytes, std::size_t offset) {
  return std::bit_cast<double>(IntegerAt(bytes, offset));
}

}  // namespace

std::string PackTrajectory(const std::vector<TrajectoryPose>& trajectory) {
  std::string bytes;
  bytes.reserve(trajectory.size() * kPoseBytes);
  for (const TrajectoryPose& pose : trajectory) {
    Append(bytes, ToNanoseconds(pose.stamp));
    Append(bytes, pose.T_map_vehicle.x());
    Append(bytes, pose.T_map_vehicle.y());
    Append(bytes, pose.T_map_vehicle.yaw());
  }
  return bytes;
}

std::optional<std::vector<TrajectoryPose>> UnpackTrajectory(std::string_view bytes) {
  if (bytes.size() % kPoseBytes != 0) return std::nullopt;
  std::vector<TrajectoryPose> trajectory;
  trajectory.reserve(bytes.size() / kPoseBytes);
  for (std::size_t i = 0; i < bytes.size(); i += kPoseBytes) {
    const double x = DoubleAt(bytes, i + kNumberBytes);
    const double y = DoubleAt(bytes, i + 2 * kNumberBytes);
    const double yaw = DoubleAt(bytes, i + 3 * kNumberBytes);
    if (!std::isfinite(x) || !std::isfinite(y) || !std::isfinite(yaw)) return std::nullopt;
    trajectory.push_back({StampFromNanoseconds(IntegerAt(bytes, i)), Se2(x, y, yaw)});
  }
  return trajectory;
}

std::string PackLogLikelihoods(const std::vector<VisitEvidence::ModeLogLikelihood>& modes) {
  std::string bytes;
  bytes.reserve(modes.size() * kModeBytes);
  for (const VisitEvidence::ModeLogLikelihood& mode : modes) {
    Append(bytes, mode.mode.value());
    Append(bytes, mode.log_likelihood);
  }
  return bytes;
}

std::optional<std::vector<VisitEvidence::ModeLogLikelihood>> UnpackLogLikelihoods(
    std::string_view bytes) {
  if (bytes.size() % kModeBytes != 0) return std::nullopt;
  std::vector<VisitEvidence::ModeLogLikelihood> modes;
  modes.reserve(bytes.size() / kModeBytes);
  for (std::size_t i = 0; i < bytes.size(); i += kModeBytes) {
    modes.push_back({ModeNumber(IntegerAt(bytes, i)), DoubleAt(bytes, i + kNumberBytes)});
  }
  if (!CheckLogLikelihoods(modes)) return std::nullopt;
  return modes;
}

bool CheckLogLikelihoods(const std::vector<VisitEvidence::ModeLogLikelihood>& modes) {
  if (modes.empty() || modes.front().mode != kAbsent) return false;
  for (std::size_t i = 0; i < modes.size(); ++i) {
    if (!std::isfinite(modes[i].log_likelihood)) return false;
    if (i > 0 && !(modes[i - 1].mode < modes[i].mode)) return false;
  }
  return true;
}

}  // namespace shiftmap
