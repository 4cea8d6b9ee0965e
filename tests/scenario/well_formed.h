// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace shiftmap::testing {

/// What keeps a text from being well-formed XML; empty if nothing does. Knows what pictures use:
/// a declaration, comments, nested elements, quoted attributes without doubles, text and
/// entities; no document type and no CDATA.
std::string XmlDefect(const std::string& text);

}  // namespace shiftmap::testing
