// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string_view>

namespace shiftmap {

/// Takes the first code point off `text`, which is not empty. Nothing if its bytes are not
/// well-formed (RFC 3629: no overlong forms, no surrogates, at most U+10FFFF); `text` then loses
/// one byte.
std::optional<char32_t> TakeCodePoint(std::string_view* text);

/// True if `text` is well-formed UTF-8. Protobuf strings must be; a reader rejects a message in
/// which one is not.
bool IsUtf8(std::string_view text);

}  // namespace shiftmap
