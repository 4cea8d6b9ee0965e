// SPDX-License-Identifier: Apache-2.0
#include "tests/scenario/well_formed.h"

#include <regex>
#include <set>
#include <string_view>
#include <vector>

namespace shiftmap::testing {
namespace {

// Text and attribute values: no bare markup, only known entities.
bool IsPlain(const std::string& text) {
  static const std::regex entity("&(amp|lt|gt|quot|apos|#[0-9]+|#x[0-9a-fA-F]+);");
  const std::string rest = std::regex_replace(text, entity, "");
  return rest.find_first_of("<&") == std::string::npos;
}

// The attributes of a start tag, behind the element's name.
std::string AttributeDefect(const std::string& text) {
  static const std::regex attribute(
      "\\s+([A-Za-z_:][-A-Za-z0-9_:.]*)\\s*=\\s*(\"[^\"]*\"|'[^']*')");
  std::set<std::string> names;
  std::size_t end = 0;
  for (std::sregex_iterator it(text.begin(), text.end(), attribute), none; it != none; ++it) {
    if (static_cast<std::size_t>(it->position()) != end) return "attributes '" + text + "'";
    end += static_cast<std::size_t>(it->length());
    if (!names.insert((*it)[1]).second) return "attribute '" + it->str(1) + "' twice";
    if (!IsPlain((*it)[2])) return "attribute value " + it->str(2);
  }
  if (text.find_first_not_of(" \t\r\n", end) != std::string::npos)
    return "attributes '" + text + "'";
  return "";
}

class Checker {
 public:
  std::string Check(const std::string& text) {
    std::size_t at = 0;
    while (at < text.size()) {
      const std::size_t open = text.find('<', at);
      const std::string between = text.substr(at, open - at);
      if (!IsPlain(between)) return "text '" + between + "'";
      const bool blank = between.find_first_not_of(" \t\r\n") == std::string::npos;
      if (!blank && open_.empty()) return "text outside of the root";
      if (open == std::string::npos) break;
      const bool comment = text.compare(open, 4, "<!--") == 0;
      const std::string_view closer = comment ? "-->" : ">";
      const std::size_t close = text.find(closer, open + (comment ? 4 : 1));
      if (close == std::string::npos) return "markup without an end";
      at = close + closer.size();
      if (comment) continue;
      const std::string defect = Tag(text.substr(open + 1, close - open - 1), open == 0);
      if (!defect.empty()) return defect;
    }
    if (!open_.empty()) return "element '" + open_.back() + "' is not closed";
    return roots_ == 1 ? "" : "not one root";
  }

 private:
  // One tag without its brackets.
  std::string Tag(std::string tag, bool first) {
    if (tag.starts_with('?')) return first && tag.ends_with('?') ? "" : "declaration inside";
    if (tag.starts_with('/')) {
      const std::string name = tag.substr(1, tag.find_last_not_of(" \t\r\n"));
      if (open_.empty() || open_.back() != name) return "stray end of '" + name + "'";
      open_.pop_back();
      return "";
    }
    const bool empty = tag.ends_with('/');
    if (empty) tag.pop_back();
    const std::size_t length = std::min(tag.find_first_of(" \t\r\n"), tag.size());
    static const std::regex name_pattern("[A-Za-z_:][-A-Za-z0-9_:.]*");
    const std::string name = tag.substr(0, length);
    if (!std::regex_match(name, name_pattern)) return "element name '" + name + "'";
    if (open_.empty()) ++roots_;
    if (!empty) open_.push_back(name);
    return AttributeDefect(tag.substr(length));
  }

  std::vector<std::string> open_;
  int roots_ = 0;
};

}  // namespace

std::string XmlDefect(const std::string& text) { return Checker().Check(text); }

}  // namespace shiftmap::testing
