// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/svg.h"

#include <fmt/format.h>

#include <algorithm>
#include <numbers>

namespace shiftmap {
namespace {

std::string Escape(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    switch (c) {
      case '&':
        escaped += "&amp;";
        break;
      case '<':
        escaped += "&lt;";
        break;
      case '>':
        escaped += "&gt;";
        break;
      case '"':
        escaped += "&quot;";
        break;
      default:
        // XML has no way to write a control character.
        escaped += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
    }
  }
  return escaped;
}

std::string Attributes(const SvgStyle& style) {
  std::string text = fmt::format(R"(fill="{}")", style.fill);
  if (style.stroke != "none") {
    text += fmt::format(R"( stroke="{}" stroke-width="{:.4g}")", style.stroke, style.stroke_width);
  }
  if (style.opacity < 1.0) text += fmt::format(R"( opacity="{:.3g}")", style.opacity);
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

}  // namespace

Svg::Svg(double width, double height) : width_(width), height_(height) {}

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
  for (const Eigen::Vector2d& p : points) body_ += fmt::format("{:.2f},{:.2f} ", p.x(), p.y());
  body_ += fmt::format("\" {}/>\n", Attributes(style));
}

void Svg::Rect(const Eigen::Vector2d& corner, const Eigen::Vector2d& size, const SvgStyle& style) {
  body_ += fmt::format("<rect x=\"{:.2f}\" y=\"{:.2f}\" width=\"{:.2f}\" height=\"{:.2f}\" {}/>\n",
                       corner.x(),
                       corner.y(),
                       size.x(),
                       size.y(),
                       Attributes(style));
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
  body_ += tooltip.empty() ? "/>\n" : fmt::format("><title>{}</title></circle>\n", Escape(tooltip));
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

void Svg::Text(const Eigen::Vector2d& at, const std::string& text, const SvgText& style) {
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

double Svg::TextWidth(const std::string& text, double size) {
  // The mean advance of sans-serif letters and digits; bytes after the first of a character have
  // no width.
  constexpr double kAdvance = 0.62;
  const auto characters =
      std::count_if(text.begin(), text.end(), [](char c) { return (c & 0xC0) != 0x80; });
  return kAdvance * size * static_cast<double>(characters);
}

}  // namespace shiftmap
