// SPDX-License-Identifier: Apache-2.0
#include "tools/view/view_page.h"

#include <nlohmann/json.hpp>

#include "tools/view/page_template.h"

namespace shiftmap {
namespace {

// Inside a JSON document these three occur in strings only.
std::string Embeddable(const std::string& json) {
  std::string text;
  text.reserve(json.size() + json.size() / 16);
  for (const char c : json) {
    if (c == '<' || c == '>' || c == '&') {
      text += fmt::format("\\u{:04x}", static_cast<unsigned char>(c));
    } else {
      text += c;
    }
  }
  return text;
}

}  // namespace

Status CheckWebView() {
  if (ViewPageTemplate().built()) return OkStatus();
  return FailedPrecondition(
      "this build has no web view: it was configured with SHIFTMAP_WEB_VIEW=OFF, or without npm");
}

StatusOr<std::string> ViewPage(const Json& document) {
  SHIFTMAP_RETURN_IF_ERROR(CheckWebView());
  const PageTemplate& page = ViewPageTemplate();
  constexpr bool kAscii = true;
  return page.head + Embeddable(document.dump(-1, ' ', kAscii, Json::error_handler_t::replace)) +
         page.tail;
}

}  // namespace shiftmap
