// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/svg.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <iterator>
#include <numbers>

#include "mapstore/core/inert_text.h"
#include "mapstore/core/utf8.h"

namespace shiftmap {
namespace {

std::string Escape(std::string_view text) {
  // XML has no way to write these two characters; InertLine() leaves them.
  constexpr std::string_view kNoCharacters[] = {"\xEF\xBF\xBE", "\xEF\xBF\xBF"};
  std::string inert = InertLine(text);
  for (const std::string_view none : kNoCharacters) {
    for (std::size_t at = inert.find(none); at != std::string::npos; at = inert.find(none, at)) {
      inert.replace(at, none.size(), "?");
    }
  }
  return EscapeMarkup(inert);
}

std::string Attributes(const SvgStyle& style) {
  std::string text = fmt::format(R"(fill="{}")", style.fill);
  if (style.stroke != "none") {
    text += fmt::format(R"( stroke="{}" stroke-width="{:.4g}")", style.stroke, style.stroke_width);
  }
  if (style.opacity < 1.0) text += fmt::format(R"( opacity="{:.3g}")", style.opacity);
  if (style.fill_opacity < 1.0) {
    text += fmt::format(R"( fill-opacity="{:.3g}")", style.fill_opacity);
  }
  if (!style.dash.empty()) text += fmt::format(R"( stroke-dasharray="{}")", style.dash);
  return text;
}

const char* AnchorName(SvgAnchor anchor) {
  switch (anchor) {
    case SvgAnchor::kStart:
      return "start";
    case SvgAnchor::kMiddle:
      return "middle";
    case SvgAnchor::kEnd:
      return "end";
  }
  return "start";
}

void AppendPoints(std::span<const Eigen::Vector2d> points, std::string* out) {
  for (const Eigen::Vector2d& p : points) {
    fmt::format_to(std::back_inserter(*out), "{:.2f},{:.2f} ", p.x(), p.y());
  }
}

// Advances of DejaVu Sans from U+0020 to U+007E, in hundredths of the size.
constexpr std::array<std::uint8_t, 95> kAdvances = {
    32, 40, 46, 84, 64, 95, 78, 28, 39,  39, 50, 84, 32, 36, 32, 34, 64, 64, 64, 64, 64, 64, 64, 64,
    64, 64, 34, 34, 84, 84, 84, 53, 100, 68, 69, 70, 77, 63, 58, 78, 75, 30, 30, 66, 56, 86, 75, 79,
    60, 79, 70, 64, 61, 73, 68, 99, 69,  61, 69, 39, 34, 39, 84, 50, 50, 61, 64, 55, 64, 62, 35, 64,
    63, 28, 28, 58, 28, 97, 63, 61, 64,  64, 41, 52, 39, 63, 59, 82, 59, 59, 53, 64, 34, 64, 84};

double Advance(char32_t c) {
  constexpr char32_t kFirst = 0x20;
  if (c >= kFirst && c < kFirst + kAdvances.size()) return 0.01 * kAdvances[c - kFirst];
  constexpr double kLatin = 0.64;
  constexpr double kWide = 1.0;
  // The middle dot, then letters, then arrows, signs and ideographs.
  if (c == 0xB7) return 0.32;
  return c < 0x2000 || c == 0x2013 ? kLatin : kWide;
}

}  // namespace

Svg::Svg(double width, double height) : width_(width), height_(height) {}

void Svg::Close(std::string_view element, const std::string& tooltip) {
  body_ +=
      tooltip.empty() ? "/>\n" : fmt::format("><title>{}</title></{}>\n", Escape(tooltip), element);
}

void Svg::Line(const Eigen::Vector2d& from, const Eigen::Vector2d& to, const SvgStyle& style) {
  body_ += fmt::format("<line x1=\"{:.2f}\" y1=\"{:.2f}\" x2=\"{:.2f}\" y2=\"{:.2f}\" {}/>\n",
                       from.x(),
                       from.y(),
                       to.x(),
                       to.y(),
                       Attributes(style));
}

void Svg::Polyline(std::span<const Eigen::Vector2d> points, const SvgStyle& style) {
  body_ += "<polyline stroke-linejoin=\"round\" points=\"";
  AppendPoints(points, &body_);
  body_ += fmt::format("\" {}/>\n", Attributes(style));
}

void Svg::Polygon(std::span<const Eigen::Vector2d> points,
                  const SvgStyle& style,
                  const std::string& tooltip) {
  body_ += "<polygon points=\"";
  AppendPoints(points, &body_);
  body_ += fmt::format("\" {}", Attributes(style));
  Close("polygon", tooltip);
}

void Svg::Rect(const Eigen::Vector2d& corner,
               const Eigen::Vector2d& size,
               const SvgStyle& style,
               const std::string& tooltip) {
  body_ += fmt::format("<rect x=\"{:.2f}\" y=\"{:.2f}\" width=\"{:.2f}\" height=\"{:.2f}\" {}",
                       corner.x(),
                       corner.y(),
                       size.x(),
                       size.y(),
                       Attributes(style));
  Close("rect", tooltip);
}

void Svg::Circle(const Eigen::Vector2d& centre,
                 double radius,
                 const SvgStyle& style,
                 const std::string& tooltip) {
  body_ += fmt::format("<circle cx=\"{:.2f}\" cy=\"{:.2f}\" r=\"{:.2f}\" {}",
                       centre.x(),
                       centre.y(),
                       radius,
                       Attributes(style));
  Close("circle", tooltip);
}

void Svg::Ellipse(const Eigen::Vector2d& centre,
                  const Eigen::Vector2d& half_axes,
                  double rotation_rad,
                  const SvgStyle& style) {
  body_ += fmt::format(
      "<ellipse rx=\"{:.2f}\" ry=\"{:.2f}\" transform=\"translate({:.2f} {:.2f}) rotate({:.2f})\" "
      "{}/>\n",
      half_axes.x(),
      half_axes.y(),
      centre.x(),
      centre.y(),
      rotation_rad * 180.0 / std::numbers::pi,
      Attributes(style));
}

void Svg::Dots(std::span<const Eigen::Vector2d> centres,
               double radius,
               const std::string& color,
               double opacity) {
  if (centres.empty()) return;
  body_ += "<path d=\"";
  for (const Eigen::Vector2d& p : centres) {
    fmt::format_to(std::back_inserter(body_), "M{:.1f} {:.1f}h0", p.x(), p.y());
  }
  body_ +=
      fmt::format("\" stroke-linecap=\"round\" {}/>\n",
                  Attributes({.stroke = color, .stroke_width = 2.0 * radius, .opacity = opacity}));
}

void Svg::Segments(std::span<const Eigen::Vector2d> ends, const SvgStyle& style) {
  if (ends.size() < 2) return;
  body_ += "<path d=\"";
  for (std::size_t i = 0; i + 1 < ends.size(); i += 2) {
    fmt::format_to(std::back_inserter(body_),
                   "M{:.1f} {:.1f}L{:.1f} {:.1f}",
                   ends[i].x(),
                   ends[i].y(),
                   ends[i + 1].x(),
                   ends[i + 1].y());
  }
  body_ += fmt::format("\" {}/>\n", Attributes(style));
}

void Svg::Arrow(const Eigen::Vector2d& from,
                const Eigen::Vector2d& to,
                double head,
                const SvgStyle& style) {
  const double length = (to - from).norm();
  if (!(length > 0.0)) return;
  const Eigen::Vector2d along = (to - from) / length;
  const Eigen::Vector2d across(-along.y(), along.x());
  const double size = std::min(head, 0.7 * length);
  const Eigen::Vector2d neck = to - size * along;
  SvgStyle tip{.fill = style.stroke, .opacity = style.opacity};
  Line(from, neck, style);
  Polygon(std::array{to,
                     Eigen::Vector2d(neck + 0.45 * size * across),
                     Eigen::Vector2d(neck - 0.45 * size * across)},
          tip);
}

void Svg::Text(const Eigen::Vector2d& at, std::string_view text, const SvgText& style) {
  body_ += fmt::format(
      "<text x=\"{:.2f}\" y=\"{:.2f}\" font-size=\"{:.4g}\" fill=\"{}\" text-anchor=\"{}\"{}{}>{}"
      "</text>\n",
      at.x(),
      at.y(),
      style.size,
      style.fill,
      AnchorName(style.anchor),
      style.bold ? " font-weight=\"bold\"" : "",
      style.halo ? " stroke=\"#ffffff\" stroke-width=\"3\" stroke-linejoin=\"round\" "
                   "paint-order=\"stroke\""
                 : "",
      Escape(text));
}

std::string Svg::ToString() const {
  return fmt::format(
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0:.0f}\" height=\"{1:.0f}\" "
      "viewBox=\"0 0 {0:.0f} {1:.0f}\" "
      "font-family=\"DejaVu Sans, Helvetica, Arial, sans-serif\">\n"
      "<rect width=\"{0:.0f}\" height=\"{1:.0f}\" fill=\"#ffffff\"/>\n{2}</svg>\n",
      width_,
      height_,
      body_);
}

double Svg::TextWidth(std::string_view text, double size, bool bold) {
  constexpr double kBold = 1.13;
  const std::string inert = InertLine(text);
  std::string_view rest = inert;
  double advance = 0.0;
  while (!rest.empty()) advance += Advance(TakeCodePoint(&rest).value_or(U'?'));
  return advance * size * (bold ? kBold : 1.0);
}

std::string Svg::Shortened(std::string_view text, double size, double width, bool bold) {
  std::string inert = InertLine(text);
  if (TextWidth(inert, size, bold) <= width) return inert;
  constexpr std::string_view kEllipsis = "…";
  const double room = width - TextWidth(kEllipsis, size, bold);
  std::string_view rest = inert;
  double taken = 0.0;
  std::size_t kept = 0;
  while (!rest.empty()) {
    const std::string_view before = rest;
    TakeCodePoint(&rest);
    taken += TextWidth(before.substr(0, before.size() - rest.size()), size, bold);
    if (taken > room) break;
    kept = inert.size() - rest.size();
  }
  return inert.substr(0, kept) + std::string(kEllipsis);
}

}  // namespace shiftmap
