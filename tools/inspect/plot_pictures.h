// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "mapstore/cli/context.h"
#include "proto/core/status.h"
#include "tools/inspect/store_arguments.h"

namespace shiftmap {

/// What a picture is made from.
struct PictureArguments {
  StoreArguments store;
  std::vector<std::string> subjects;  ///< Signature, versions or files, by the kind of picture.
  std::string truth;                  ///< True trajectory; empty for none.
  bool align = false;                 ///< Move the truth onto the estimate first.
};

struct Picture {
  std::string svg;
  Json about;  ///< What was drawn, for the report.
};

// One function per kind of picture. Errors: as what each reads.
StatusOr<Picture> DrawMap(const PictureArguments& arguments, const Context& context);
StatusOr<Picture> DrawModes(const PictureArguments& arguments, const Context& context);
StatusOr<Picture> DrawHistory(const PictureArguments& arguments, const Context& context);
StatusOr<Picture> DrawDiff(const PictureArguments& arguments, const Context& context);
StatusOr<Picture> DrawTrajectories(const PictureArguments& arguments, const Context& context);
StatusOr<Picture> DrawConsistency(const PictureArguments& arguments, const Context& context);
StatusOr<Picture> DrawRates(const PictureArguments& arguments, const Context& context);
StatusOr<Picture> DrawNight(const PictureArguments& arguments, const Context& context);

}  // namespace shiftmap
