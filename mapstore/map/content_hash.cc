// SPDX-License-Identifier: Apache-2.0
//
// The canonical rows of a map. Every value is written with its length or as 8 fixed bytes,
// big-endian, so that no two contents share a row stream. The layout is part of the store's format:
// see mapstore/FORMATS.md.
#include <bit>
#include <cstdint>

#include "mapstore/map/map_snapshot.h"
#include "mapstore/map/sha256.h"

namespace shiftmap {
namespace {

class RowHasher {
 public:
  void Add(std::int64_t value) {
    char bytes[8];
    const auto bits = static_cast<std::uint64_t>(value);
    for (int i = 0; i < 8; ++i) bytes[i] = static_cast<char>(bits >> (56 - 8 * i));
    hash_.Update({bytes, sizeof bytes});
  }

  // The bits of the number, with -0 as 0.
  void Add(double value) { Add(std::bit_cast<std::int64_t>(value == 0.0 ? 0.0 : value)); }

  void Add(const std::string& text) {
    Add(static_cast<std::int64_t>(text.size()));
    hash_.Update(text);
  }

  void Add(const Eigen::Matrix2d& block) {
    for (int i = 0; i < 4; ++i) Add(block(i / 2, i % 2));
  }

  void Add(const Mode& mode) {
    Add(mode.number.value());
    Add(mode.p_map_landmark.x());
    Add(mode.p_map_landmark.y());
    // Symmetric: three numbers say it all, and a file stores no more.
    Add(mode.cov_p_map_landmark(0, 0));
    Add(mode.cov_p_map_landmark(0, 1));
    Add(mode.cov_p_map_landmark(1, 1));
    Add(ToNanoseconds(mode.last_seen));
  }

  // By rows.
  void AddOffDiagonal(const Eigen::MatrixXd& rates) {
    for (Eigen::Index from = 0; from < rates.rows(); ++from) {
      for (Eigen::Index to = 0; to < rates.cols(); ++to) {
        if (from != to) Add(rates(from, to));
      }
    }
  }

  std::string HexDigest() { return hash_.HexDigest(); }

 private:
  Sha256 hash_;
};

// Rows that came later than the layout: content without them has the hash it always had.
void AddExtensions(const MapContent& content, RowHasher& rows) {
  for (const LandmarkGroup& group : content.groups) {
    if (group.merged.empty()) continue;
    rows.Add(std::string("merged"));
    rows.Add(group.signature.text());
    rows.Add(static_cast<std::int64_t>(group.merged.size()));
    for (const MergedMode& merged : group.merged) {
      rows.Add(merged.number.value());
      rows.Add(merged.into.value());
    }
  }
  for (const LandmarkGroup& group : content.groups) {
    if (group.chain.uniform()) continue;
    rows.Add(std::string("rates"));
    rows.Add(group.signature.text());
    rows.AddOffDiagonal(group.chain.rate_matrix());
  }
  for (const LandmarkGroup& group : content.groups) {
    const ChainRhythm* const rhythm = group.chain.rhythm();
    if (rhythm == nullptr) continue;
    rows.Add(std::string("rhythm"));
    rows.Add(group.signature.text());
    rows.Add(static_cast<std::int64_t>(rhythm->calendar().period.count()));
    rows.Add(static_cast<std::int64_t>(rhythm->calendar().phases));
    for (const Eigen::MatrixXd& rates : rhythm->rate_matrices()) rows.AddOffDiagonal(rates);
  }
  for (const VehicleCalibration& vehicle : content.vehicles) {
    rows.Add(std::string("vehicle"));
    rows.Add(vehicle.vehicle);
    rows.Add(vehicle.runs);
    rows.Add(ToNanoseconds(vehicle.stamp));
    for (const double value : VehicleValues(vehicle)) rows.Add(value);
  }
}

std::string Hash(const MapContent& content, bool with_probabilities) {
  RowHasher rows;
  rows.Add(std::string(with_probabilities ? "shiftmap content 1" : "shiftmap content 2"));
  rows.Add(ToNanoseconds(content.stamp));
  rows.Add(static_cast<std::int64_t>(content.groups.size()));
  for (const LandmarkGroup& group : content.groups) {
    rows.Add(group.signature.text());
    rows.Add(group.chain.leave_rate_per_s());
    rows.Add(static_cast<std::int64_t>(group.modes.size()));
    for (const Mode& mode : group.modes) rows.Add(mode);
    if (!with_probabilities) continue;
    for (const double probability : group.probabilities) rows.Add(probability);
  }
  rows.Add(static_cast<std::int64_t>(content.covariance.cross_blocks().size()));
  for (const JointCovariance::CrossBlock& block : content.covariance.cross_blocks()) {
    rows.Add(static_cast<std::int64_t>(block.row));
    rows.Add(static_cast<std::int64_t>(block.column));
    rows.Add(block.value);
  }
  rows.Add(static_cast<std::int64_t>(content.anonymous_landmarks.size()));
  for (const Mode& landmark : content.anonymous_landmarks) rows.Add(landmark);
  for (const double value : CalibrationValues(content.calibration)) rows.Add(value);
  AddExtensions(content, rows);
  return rows.HexDigest();
}

}  // namespace

std::string ContentHash(const MapContent& content) { return Hash(content, true); }

std::string GeometryHash(const MapContent& content) { return Hash(content, false); }

}  // namespace shiftmap
