// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace shiftmap {

/// The page without its data document. The build makes it from `page/`; a build without the web
/// view has an empty one.
struct PageTemplate {
  std::string head = {};                     ///< Up to the data document,
  std::string tail = {};                     ///< and after it.
  std::string content_security_policy = {};  ///< That the page states for itself.

  bool built() const { return !head.empty(); }
};

const PageTemplate& ViewPageTemplate();

}  // namespace shiftmap
