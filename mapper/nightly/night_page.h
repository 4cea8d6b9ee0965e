// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapstore/cli/context.h"
#include "proto/core/status.h"

namespace shiftmap {

/// A picture of a page.
struct PagePicture {
  std::string area;
  std::string title;
  std::string svg;
};

/// One HTML page of a night: works from a file, without scripts, and loads nothing. Names in it,
/// and those in its pictures, are text and nothing else.
/// @param document  As NightJson gives it.
/// @param title     E.g. the time of the night.
std::string NightPage(const Json& document,
                      const std::string& title,
                      const std::vector<PagePicture>& pictures);

/// The pictures of a night: per area with a version what the build changed, and the map before and
/// after it. Drawn by `shiftmap-inspect plot` beside this program; none where that is missing or
/// cannot draw.
std::vector<PagePicture> DrawNight(const Json& document, const std::string& store);

/// Writes `<title>.json` and `<title>.html` into a folder, which is made if there is none.
/// Errors: as MakeFolder and WriteFileAtomically.
Status WriteNightReport(const Json& document,
                        const std::string& title,
                        const std::string& store,
                        const std::string& folder);

}  // namespace shiftmap
