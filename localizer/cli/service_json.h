// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "localizer/live/messages.h"
#include "mapstore/cli/context.h"

namespace shiftmap {

/// What `serve` and `ctl` say about a service.
Json ServiceJson(const live::ServiceState& state);

/// The same for people.
std::string ServiceText(const live::ServiceState& state);

/// One event; for people it is a line.
Json EventJson(const live::Event& event);
std::string EventText(const live::Event& event);

}  // namespace shiftmap
