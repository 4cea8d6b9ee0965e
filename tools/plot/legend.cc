// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/legend.h"

#include <algorithm>
#include <utility>

#include "tools/plot/palette.h"

namespace shiftmap {
namespace {

constexpr double kTextX = 28.0;
constexpr double kSymbolX = 10.0;
constexpr double kLine = 16.0;
constexpr double kBetween = 5.0;

// Lines of whole words that are no wider than `width`; a longer word is cut.
std::vector<std::string> Wrapped(const std::string& text, double width, double size, bool bold) {
  std::vector<std::string> lines;
  std::string line;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find(' ', at), text.size());
    const std::string word = text.substr(at, end - at);
    const std::string longer = line.empty() ? word : line + ' ' + word;
    if (line.empty() || Svg::TextWidth(longer, size, bold) <= width) {
      line = longer;
    } else {
      lines.push_back(Svg::Shortened(line, size, width, bold));
      line = word;
    }
    at = end + 1;
  }
  if (!line.empty()) lines.push_back(Svg::Shortened(line, size, width, bold));
  return lines;
}

}  // namespace

void Legend::Add(
    const std::string& text, double x, const SvgText& style, Symbol symbol, bool one_line) {
  height_ += kBetween;
  const double width = kWidth - x;
  std::vector<std::string> lines;
  if (one_line) {
    lines.push_back(Svg::Shortened(text, style.size, width, style.bold));
  } else {
    lines = Wrapped(text, width, style.size, style.bold);
  }
  for (std::string& line : lines) {
    height_ += kLine;
    lines_.push_back({height_, x, std::move(line), style, std::exchange(symbol, nullptr)});
  }
}

void Legend::Heading(const std::string& text) {
  if (height_ > 0.0) height_ += 10.0;
  Add(text, 0.0, {.size = 12.0, .fill = palette::kInk, .bold = true}, nullptr, false);
}

void Legend::Entry(Symbol symbol, const std::string& text) {
  Add(text, kTextX, {.size = 12.0, .fill = palette::kText}, std::move(symbol), false);
}

void Legend::Note(const std::string& text, bool one_line) {
  Add(text, 0.0, {.size = 11.0, .fill = palette::kNote}, nullptr, one_line);
}

void Legend::Draw(const Eigen::Vector2d& corner, Svg* svg) const {
  for (const Line& line : lines_) {
    if (line.symbol) line.symbol(corner + Eigen::Vector2d(kSymbolX, line.y - 8.0), svg);
    svg->Text(corner + Eigen::Vector2d(line.x, line.y - 4.0), line.text, line.style);
  }
}

void DrawTitles(
    const std::string& title, const std::string& subtitle, double left, double width, Svg* svg) {
  constexpr double kTitle = 18.0;
  constexpr double kSubtitle = 12.0;
  svg->Text({left, 26.0},
            Svg::Shortened(title, kTitle, width, true),
            {.size = kTitle, .fill = palette::kInk, .bold = true});
  svg->Text({left, 46.0},
            Svg::Shortened(subtitle, kSubtitle, width),
            {.size = kSubtitle, .fill = palette::kNote});
}

}  // namespace shiftmap
