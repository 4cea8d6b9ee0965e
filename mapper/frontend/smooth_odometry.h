// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapstore/run/run.h"

namespace shiftmap {

/// What all samples of a log say of the velocity at each of them, without the samples' noise.
///
/// A velocity that walks at random, told by samples u_j with white noise, has the mean
/// Σ ρ^|j - k| u_j / Σ ρ^|j - k| at sample k (Muth, JASA 55, 1960). v and omega have each the ρ of
/// a grid by which the other samples predict each one best: 0 without noise, almost 1 where the
/// samples are noise alone.
/// @param odometry  By non-decreasing stamp.
std::vector<OdometrySample> SmoothOdometry(const std::vector<OdometrySample>& odometry);

/// The usual time from a sample to the next, 1 µs at least. [s]
double SamplePeriod(const std::vector<OdometrySample>& odometry);

}  // namespace shiftmap
