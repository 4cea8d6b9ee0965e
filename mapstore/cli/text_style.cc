// SPDX-License-Identifier: Apache-2.0
#include "mapstore/cli/text_style.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cstdlib>
#include <cstring>

#include "mapstore/core/inert_text.h"

namespace shiftmap {
namespace {

// Control characters that stand for the emphasis of what follows, and for its end.
constexpr char kStrongMark = '\x01';
constexpr char kFaintMark = '\x02';
constexpr char kGoodMark = '\x03';
constexpr char kAlarmMark = '\x04';
constexpr char kEndMark = '\x05';

bool IsMark(char c) { return c >= kStrongMark && c <= kEndMark; }

const char* EscapeOf(char mark) {
  switch (mark) {
    case kStrongMark:
      return "\033[1m";
    case kFaintMark:
      return "\033[2m";
    case kGoodMark:
      return "\033[32m";
    case kAlarmMark:
      return "\033[31m";
    default:
      return "\033[0m";
  }
}

int SizeFromEnvironment(const char* name, int fallback) {
  const char* const text = std::getenv(name);
  if (text == nullptr) return fallback;
  int value = 0;
  const auto [end, error] = std::from_chars(text, text + std::strlen(text), value);
  return error == std::errc() && *end == '\0' && value > 0 ? value : fallback;
}

}  // namespace

TextStyle StandardOutputStyle() {
  if (::isatty(STDOUT_FILENO) != 1) return {};
  TextStyle style;
  struct winsize size = {};
  if (::ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) == 0) {
    style.columns = size.ws_col;
    style.rows = size.ws_row;
  }
  style.columns = SizeFromEnvironment("COLUMNS", style.columns);
  style.rows = SizeFromEnvironment("LINES", style.rows);
  const char* const no_colour = std::getenv("NO_COLOR");
  const char* const terminal = std::getenv("TERM");
  style.colour = (no_colour == nullptr || *no_colour == '\0') &&
                 (terminal == nullptr || std::strcmp(terminal, "dumb") != 0);
  return style;
}

std::string Marked(std::string_view text, Emphasis emphasis) {
  char mark = kEndMark;
  switch (emphasis) {
    case Emphasis::kNone:
      return std::string(text);
    case Emphasis::kStrong:
      mark = kStrongMark;
      break;
    case Emphasis::kFaint:
      mark = kFaintMark;
      break;
    case Emphasis::kGood:
      mark = kGoodMark;
      break;
    case Emphasis::kAlarm:
      mark = kAlarmMark;
      break;
  }
  std::string marked(1, mark);
  marked += text;
  marked += kEndMark;
  return marked;
}

std::size_t DisplayWidth(std::string_view text) {
  return static_cast<std::size_t>(std::count_if(
      text.begin(), text.end(), [](char c) { return (c & 0xC0) != 0x80 && !IsMark(c); }));
}

std::string RenderMarks(std::string_view text, bool colour) {
  std::string rendered;
  while (!text.empty()) {
    const auto mark = std::find_if(text.begin(), text.end(), IsMark);
    const auto plain = static_cast<std::size_t>(mark - text.begin());
    rendered += InertText(text.substr(0, plain));
    if (mark != text.end() && colour) rendered += EscapeOf(*mark);
    text.remove_prefix(std::min(plain + 1, text.size()));
  }
  return rendered;
}

std::string Wrapped(std::string_view text, std::size_t columns) {
  constexpr std::string_view kIndent = "  ";
  std::string wrapped;
  while (!text.empty()) {
    std::string_view line = text.substr(0, text.find('\n'));
    const bool ends = line.size() < text.size();
    text.remove_prefix(line.size() + (ends ? 1 : 0));
    std::size_t room = columns;
    while (columns > 0 && DisplayWidth(line) > room) {
      // The last blank that leaves what is before it narrow enough, else the first one of all.
      std::size_t end = line.find_first_not_of(' ');
      end = end == std::string_view::npos ? end : line.find(' ', end);
      for (std::size_t next = end; next != std::string_view::npos;
           next = line.find(' ', next + 1)) {
        if (DisplayWidth(line.substr(0, next)) > room) break;
        end = next;
      }
      if (end == std::string_view::npos) break;
      wrapped += line.substr(0, end);
      line.remove_prefix(std::min(line.find_first_not_of(' ', end), line.size()));
      wrapped += line.empty() ? "" : "\n" + std::string(kIndent);
      room = columns > kIndent.size() ? columns - kIndent.size() : 1;
    }
    wrapped += line;
    if (ends) wrapped += '\n';
  }
  return wrapped;
}

std::string Shortened(const std::string& text, std::size_t width) {
  if (DisplayWidth(text) <= width) return text;
  std::size_t characters = 0;
  std::size_t end = 0;
  while (end < text.size() && characters + 1 < width) {
    ++end;
    while (end < text.size() && (text[end] & 0xC0) == 0x80) ++end;
    ++characters;
  }
  return width == 0 ? "" : text.substr(0, end) + "…";
}

}  // namespace shiftmap
