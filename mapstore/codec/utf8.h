// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>

namespace shiftmap {

/// True if `text` is well-formed UTF-8 (RFC 3629: no overlong forms, no surrogates, at most
/// U+10FFFF). Protobuf strings must be; a reader rejects a message in which one is not.
bool IsUtf8(std::string_view text);

}  // namespace shiftmap
