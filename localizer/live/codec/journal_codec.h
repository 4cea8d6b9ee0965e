// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "localizer/live/messages.h"
#include "proto/core/status.h"

namespace shiftmap::live {

/// What the localizer keeps on disk, as Protobuf bytes (proto/live.proto). Doubles keep every bit.
/// Errors: kInvalidArgument.
std::string EncodeJournalRecord(const JournalRecord& record);
StatusOr<JournalRecord> DecodeJournalRecord(std::string_view bytes);

std::string EncodeSavedPose(const SavedPose& saved);
StatusOr<SavedPose> DecodeSavedPose(std::string_view bytes);

std::string EncodeActionStates(const std::vector<ActionState>& actions);
StatusOr<std::vector<ActionState>> DecodeActionStates(std::string_view bytes);

}  // namespace shiftmap::live
