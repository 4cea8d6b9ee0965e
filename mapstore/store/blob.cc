// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/blob.h"

#include <bit>
#include <cmath>
#include <cstring>

namespace shiftmap {
namespace {

constexpr std::size_t kNumberBytes = 8;
constexpr std::size_t kPoseNumbers = 4;
constexpr std::size_t kModeNumbers = 2;

// To big-endian and back.
std::uint64_t BigEndian(std::uint64_t bits) {
  if constexpr (std::endian::native == std::endian::little) return __builtin_bswap64(bits);
  return bits;
}

bool HoldsWhole(std::string_view bytes, std::size_t numbers) {
  return bytes.size() % (numbers * kNumberBytes) == 0;
}

}  // namespace

void BlobWriter::Add(std::int64_t value) {
  const std::uint64_t bits = BigEndian(static_cast<std::uint64_t>(value));
  char bytes[kNumberBytes];
  std::memcpy(bytes, &bits, kNumberBytes);
  bytes_.append(bytes, kNumberBytes);
}

void BlobWriter::Add(double value) { Add(std::bit_cast<std::int64_t>(value)); }

std::int64_t BlobReader::Integer() {
  std::uint64_t bits = 0;
  std::memcpy(&bits, bytes_.data(), kNumberBytes);
  bytes_.remove_prefix(kNumberBytes);
  return static_cast<std::int64_t>(BigEndian(bits));
}

double BlobReader::Double() { return std::bit_cast<double>(Integer()); }

std::string PackTrajectory(const std::vector<TrajectoryPose>& trajectory) {
  BlobWriter blob;
  for (const TrajectoryPose& pose : trajectory) {
    blob.Add(ToNanoseconds(pose.stamp));
    blob.Add(pose.T_map_vehicle.x());
    blob.Add(pose.T_map_vehicle.y());
    blob.Add(pose.T_map_vehicle.yaw());
  }
  return blob.bytes();
}

std::optional<std::vector<TrajectoryPose>> UnpackTrajectory(std::string_view bytes) {
  if (!HoldsWhole(bytes, kPoseNumbers)) return std::nullopt;
  std::vector<TrajectoryPose> trajectory;
  BlobReader blob(bytes);
  while (blob.left() > 0) {
    const Stamp stamp = StampFromNanoseconds(blob.Integer());
    const double x = blob.Double();
    const double y = blob.Double();
    const double yaw = blob.Double();
    if (!std::isfinite(x) || !std::isfinite(y) || !std::isfinite(yaw)) return std::nullopt;
    trajectory.push_back({stamp, Se2(x, y, yaw)});
  }
  return trajectory;
}

std::string PackLogLikelihoods(const std::vector<VisitEvidence::ModeLogLikelihood>& modes) {
  BlobWriter blob;
  for (const VisitEvidence::ModeLogLikelihood& mode : modes) {
    blob.Add(mode.mode.value());
    blob.Add(mode.log_likelihood);
  }
  return blob.bytes();
}

bool UnpackLogLikelihoods(std::string_view bytes,
                          std::vector<VisitEvidence::ModeLogLikelihood>* modes) {
  modes->clear();
  if (!HoldsWhole(bytes, kModeNumbers)) return false;
  BlobReader blob(bytes);
  while (blob.left() > 0) {
    const ModeNumber number(blob.Integer());
    modes->push_back({number, blob.Double()});
  }
  return CheckLogLikelihoods(*modes);
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
