// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `alignments`: how often the alignment of two maps with moved landmarks is right, against its
/// probability and other methods (alignments.h).
void AddAlignmentsExperiment(Application* application);

}  // namespace shiftmap
