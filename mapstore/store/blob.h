// SPDX-License-Identifier: Apache-2.0
//
// The BLOBs of the schema: numbers of 8 bytes, big-endian, doubles by their IEEE 754 bits.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "mapstore/map/evidence.h"
#include "mapstore/map_store.h"

namespace shiftmap {

/// version_run.trajectory: 32 bytes a pose, stamp [ns], x [m], y [m], yaw [rad].
std::string PackTrajectory(const std::vector<TrajectoryPose>& trajectory);

/// Nothing if the bytes are no such BLOB.
std::optional<std::vector<TrajectoryPose>> UnpackTrajectory(std::string_view bytes);

/// visit_evidence.log_likelihoods: 16 bytes a mode, mode number, log-likelihood [nat].
std::string PackLogLikelihoods(const std::vector<VisitEvidence::ModeLogLikelihood>& modes);

/// Nothing if the bytes are no such BLOB, or not as CheckLogLikelihoods demands.
std::optional<std::vector<VisitEvidence::ModeLogLikelihood>> UnpackLogLikelihoods(
    std::string_view bytes);

/// True if `modes` is what the filter relies on: `absent` first, ascending numbers, finite values.
bool CheckLogLikelihoods(const std::vector<VisitEvidence::ModeLogLikelihood>& modes);

}  // namespace shiftmap
