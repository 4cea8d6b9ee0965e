// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "mapstore/map/map_edit.h"

namespace shiftmap::testing {

/// An edit of a landmark that was never renamed, with author and reason.
inline MapEdit MakeEdit(EditKind kind, const std::string& signature) {
  MapEdit edit;
  edit.kind = kind;
  edit.author = "surveyor";
  edit.reason = "test";
  edit.signature = edit.landmark = Signature(signature);
  return edit;
}

/// A rename of it.
inline MapEdit MakeRename(const std::string& landmark, const std::string& name, int id) {
  MapEdit edit = MakeEdit(EditKind::kRename, landmark);
  edit.new_name = Signature(name);
  edit.id = EditId(id);
  return edit;
}

}  // namespace shiftmap::testing
