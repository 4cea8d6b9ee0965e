// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace shiftmap {

/// The name that a person most likely meant by a text that is none of them, or nothing if none is
/// near: by the number of insertions, deletions, substitutions and swaps of neighbours (optimal
/// string alignment), at most a third of the text's characters. A missing end costs little, so that
/// `--leve-rate` finds `--leave-rate-per-s`. Of equally near ones the first.
std::optional<std::string> NearestName(std::string_view text,
                                       const std::vector<std::string>& names);

/// `; did you mean 'NAME'?` of NearestName(), or nothing: for the end of a message.
std::string DidYouMean(std::string_view text, const std::vector<std::string>& names);

}  // namespace shiftmap
