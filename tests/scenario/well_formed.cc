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

bool IsName(const std::string& text) {
  static const std::regex name("[A-Za-z_:][-A-Za-z0-9_:.]*");
  return std::regex_match(text, name);
}

// The attributes of a start tag, behind the element's name. Values are as long as a trajectory is,
// which a regular expression would go down into character by character.
std::string AttributeDefect(const std::string& text) {
  constexpr char kBlank[] = " \t\r\n";
  std::set<std::string> names;
  std::size_t at = text.find_first_not_of(kBlank);
  for (std::size_t before = 0; at != std::string::npos; at = text.find_first_not_of(kBlank, at)) {
    const std::size_t equals = text.find('=', at);
    if (at == before || equals == std::string::npos) return "attributes '" + text + "'";
    const std::string name = text.substr(at, text.find_last_not_of(kBlank, equals - 1) + 1 - at);
    if (!IsName(name)) return "attribute name '" + name + "'";
    const std::size_t quote = text.find_first_not_of(kBlank, equals + 1);
    if (quote == std::string::npos || (text[quote] != '"' && text[quote] != '\'')) {
      return "attributes '" + text + "'";
    }
    const std::size_t end = text.find(text[quote], quote + 1);
    if (end == std::string::npos) return "attributes '" + text + "'";
    const std::string value = text.substr(quote + 1, end - quote - 1);
    if (!names.insert(name).second) return "attribute '" + name + "' twice";
    if (!IsPlain(value)) return "attribute value '" + value + "'";
    at = before = end + 1;
  }
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
    const std::string name = tag.substr(0, length);
    if (!IsName(name)) return "element name '" + name + "'";
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
