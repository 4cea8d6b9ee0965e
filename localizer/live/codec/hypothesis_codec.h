// SPDX-License-Identifier: Apache-2.0
//
// Inside codec/ only: it names generated types.
#pragma once

#include "localizer/hypothesis/hypothesis_view.h"
#include "proto/core/status.h"
#include "proto/live.pb.h"

namespace shiftmap::live {

void ToProto(const HypothesisView& view, proto::Hypotheses* out);

/// Errors: kInvalidArgument for nodes that are no tree, a pose of other than 3 numbers, and
/// probabilities that are not one per mode.
StatusOr<HypothesisView> HypothesesFromProto(const proto::Hypotheses& in);

}  // namespace shiftmap::live
