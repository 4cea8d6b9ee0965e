// SPDX-License-Identifier: Apache-2.0
#include "tools/view/page_template.h"

namespace shiftmap {

const PageTemplate& ViewPageTemplate() {
  static const auto* const page = new PageTemplate();
  return *page;
}

}  // namespace shiftmap
