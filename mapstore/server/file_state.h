// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace shiftmap::server {

/// A text that changes whenever somebody writes a file or replaces it; "none" if there is no file.
std::string FileState(const std::string& path);

}  // namespace shiftmap::server
