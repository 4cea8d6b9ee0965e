// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace shiftmap {

/// The version of this build, e.g. "0.1.0".
std::string SoftwareVersion();

/// The revision of the source tree that was configured, as git abbreviates it; "unknown" outside of
/// a checkout.
std::string SoftwareRevision();

}  // namespace shiftmap
