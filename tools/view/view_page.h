// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "mapstore/cli/context.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Errors: kFailedPrecondition if this build has no web view.
Status CheckWebView();

/// The page with a data document in it: one HTML text that needs nothing else.
///
/// Text of the document cannot end the element that it stands in: `<`, `>`, `&` and everything
/// beyond ASCII are JSON escapes; bytes that are not UTF-8 become U+FFFD.
/// Errors: kFailedPrecondition if this build has no web view.
StatusOr<std::string> ViewPage(const Json& document);

}  // namespace shiftmap
