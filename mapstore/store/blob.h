// SPDX-License-Identifier: Apache-2.0
//
// The BLOBs of the schema: numbers of 8 bytes, big-endian, doubles by their IEEE 754 bits.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "mapstore/map/evidence.h"
#include "mapstore/store_types.h"

namespace shiftmap {

/// Puts such numbers together.
class BlobWriter {
 public:
  void Add(std::int64_t value);
  void Add(double value);
  const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
};

/// Takes them apart. The caller asks left() first; `bytes` is a whole number of numbers.
class BlobReader {
 public:
  explicit BlobReader(std::string_view bytes) : bytes_(bytes) {}

  std::size_t left() const { return bytes_.size() / sizeof(std::int64_t); }
  std::int64_t Integer();
  double Double();

 private:
  std::string_view bytes_;
};

/// version_run.trajectory: 32 bytes a pose, stamp [ns], x [m], y [m], yaw [rad].
std::string PackTrajectory(const std::vector<TrajectoryPose>& trajectory);

/// Nothing if the bytes are no such BLOB.
std::optional<std::vector<TrajectoryPose>> UnpackTrajectory(std::string_view bytes);

/// visit_evidence.log_likelihoods: 16 bytes a mode, mode number, log-likelihood [nat].
std::string PackLogLikelihoods(const std::vector<VisitEvidence::ModeLogLikelihood>& modes);

/// False if the bytes are no such BLOB, or not as CheckLogLikelihoods demands.
/// @param modes  Is replaced; given again, it costs no memory.
bool UnpackLogLikelihoods(std::string_view bytes,
                          std::vector<VisitEvidence::ModeLogLikelihood>* modes);

/// True if `modes` is what the filter relies on: `absent` first, ascending numbers, finite values.
bool CheckLogLikelihoods(const std::vector<VisitEvidence::ModeLogLikelihood>& modes);

}  // namespace shiftmap
