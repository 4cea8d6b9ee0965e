// SPDX-License-Identifier: Apache-2.0
#include "tests/unit/tools/plot/svg_picture.h"

#include <cairo.h>
#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <optional>
#include <sstream>

#include "tests/scenario/well_formed.h"

namespace shiftmap::testing {
namespace {

constexpr double kSlack = 1.0;  // [px]

struct Box {
  Eigen::Vector2d min = Eigen::Vector2d::Constant(1e300);
  Eigen::Vector2d max = Eigen::Vector2d::Constant(-1e300);

  void Include(const Eigen::Vector2d& p) {
    min = min.cwiseMin(p);
    max = max.cwiseMax(p);
  }
};

std::string Unescaped(std::string text) {
  const std::pair<const char*, const char*> entities[] = {
      {"&lt;", "<"}, {"&gt;", ">"}, {"&quot;", "\""}, {"&amp;", "&"}};
  for (const auto& [entity, character] : entities) {
    for (std::size_t at = text.find(entity); at != std::string::npos; at = text.find(entity, at)) {
      text.replace(at, std::string(entity).size(), character);
      ++at;
    }
  }
  return text;
}

// Measures text as a viewer with the font does.
class Ruler {
 public:
  Ruler() {
    // As a viewer at any scale does.
    cairo_font_options_t* const options = cairo_font_options_create();
    cairo_font_options_set_hint_metrics(options, CAIRO_HINT_METRICS_OFF);
    cairo_set_font_options(drawing_, options);
    cairo_font_options_destroy(options);
  }
  Ruler(const Ruler&) = delete;
  Ruler& operator=(const Ruler&) = delete;
  ~Ruler() {
    cairo_destroy(drawing_);
    cairo_surface_destroy(surface_);
  }

  double Width(const std::string& text, double size, bool bold) {
    cairo_select_font_face(drawing_,
                           "DejaVu Sans",
                           CAIRO_FONT_SLANT_NORMAL,
                           bold ? CAIRO_FONT_WEIGHT_BOLD : CAIRO_FONT_WEIGHT_NORMAL);
    cairo_set_font_size(drawing_, size);
    cairo_text_extents_t extents;
    cairo_text_extents(drawing_, text.c_str(), &extents);
    return extents.x_advance;
  }

 private:
  cairo_surface_t* surface_ = cairo_image_surface_create(CAIRO_FORMAT_A8, 1, 1);
  cairo_t* drawing_ = cairo_create(surface_);
};

Box TextBox(const SvgElement& element, Ruler* ruler) {
  const double size = element.Number("font-size");
  const double width =
      ruler->Width(element.text, size, element.attributes.count("font-weight") > 0);
  const std::string anchor = element.attributes.at("text-anchor");
  const double before = anchor == "end" ? width : anchor == "middle" ? 0.5 * width : 0.0;
  const Eigen::Vector2d base(element.Number("x") - before, element.Number("y"));
  Box box;
  box.Include(base - Eigen::Vector2d(0.0, 0.75 * size));
  box.Include(base + Eigen::Vector2d(width, 0.1 * size));
  return box;
}

Box PointsBox(const std::string& text) {
  Box box;
  std::istringstream in(text);
  double x = 0.0;
  double y = 0.0;
  char comma = 0;
  while (in >> x >> comma >> y) box.Include({x, y});
  return box;
}

// Of a path of absolute moves and lines, and relative horizontal lines of no length.
Box PathBox(std::string text) {
  for (std::size_t at = text.find("h0"); at != std::string::npos; at = text.find("h0")) {
    text.replace(at, 2, " ");
  }
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c == 'M' || c == 'L'; }, ' ');
  Box box;
  std::istringstream in(text);
  double x = 0.0;
  double y = 0.0;
  while (in >> x >> y) box.Include({x, y});
  return box;
}

Box EllipseBox(const SvgElement& element) {
  double x = 0.0;
  double y = 0.0;
  double degrees = 0.0;
  const int read = std::sscanf(element.attributes.at("transform").c_str(),
                               "translate(%lf %lf) rotate(%lf)",
                               &x,
                               &y,
                               &degrees);
  if (read != 3) return {};
  const double angle = degrees * std::numbers::pi / 180.0;
  const double rx = element.Number("rx");
  const double ry = element.Number("ry");
  const Eigen::Vector2d half(std::hypot(rx * std::cos(angle), ry * std::sin(angle)),
                             std::hypot(rx * std::sin(angle), ry * std::cos(angle)));
  Box box;
  box.Include(Eigen::Vector2d(x, y) - half);
  box.Include(Eigen::Vector2d(x, y) + half);
  return box;
}

// Nothing for what draws nothing.
std::optional<Box> BoxOf(const SvgElement& element, Ruler* ruler) {
  const auto at = [&](const char* x, const char* y) {
    return Eigen::Vector2d(element.Number(x), element.Number(y));
  };
  Box box;
  if (element.name == "line") {
    box.Include(at("x1", "y1"));
    box.Include(at("x2", "y2"));
  } else if (element.name == "rect" && element.attributes.count("x") > 0) {
    box.Include(at("x", "y"));
    box.Include(at("x", "y") + at("width", "height"));
  } else if (element.name == "circle") {
    const Eigen::Vector2d half = Eigen::Vector2d::Constant(element.Number("r"));
    box.Include(at("cx", "cy") - half);
    box.Include(at("cx", "cy") + half);
  } else if (element.name == "ellipse") {
    box = EllipseBox(element);
  } else if (element.name == "polyline" || element.name == "polygon") {
    box = PointsBox(element.attributes.at("points"));
  } else if (element.name == "path") {
    box = PathBox(element.attributes.at("d"));
  } else if (element.name == "text") {
    box = TextBox(element, ruler);
  } else {
    return std::nullopt;
  }
  return box;
}

bool Overlap(const Box& a, const Box& b) {
  return ((a.max - b.min).array() > kSlack).all() && ((b.max - a.min).array() > kSlack).all();
}

bool HasBadNumber(const SvgElement& element) {
  return std::any_of(element.attributes.begin(), element.attributes.end(), [](const auto& entry) {
    return entry.first != "font-family" && (entry.second.find("nan") != std::string::npos ||
                                            entry.second.find("inf") != std::string::npos);
  });
}

}  // namespace

MapSnapshot MapOf(const std::string& area, int version, MapContent content) {
  std::vector<Eigen::Matrix2d> marginals;
  for (const LandmarkGroup& group : content.groups) {
    for (const Mode& mode : group.modes) marginals.push_back(mode.cov_p_map_landmark);
  }
  content.covariance = JointCovariance(std::move(marginals), {});
  return MapSnapshot(area, VersionNumber(version), "hash", std::move(content));
}

double SvgElement::Number(const std::string& attribute) const {
  return std::stod(attributes.at(attribute));
}

std::vector<SvgElement> ParseSvg(const std::string& svg) {
  std::vector<SvgElement> elements;
  for (std::size_t at = svg.find('<'); at != std::string::npos; at = svg.find('<', at + 1)) {
    if (svg[at + 1] == '?' || svg[at + 1] == '/') continue;
    const std::size_t end = svg.find('>', at);
    SvgElement element;
    element.name = svg.substr(at + 1, svg.find_first_of(" >/", at + 1) - at - 1);
    std::size_t next = at + 1 + element.name.size();
    for (std::size_t quote = svg.find('"', next); quote < end; quote = svg.find('"', next)) {
      const std::size_t close = svg.find('"', quote + 1);
      const std::size_t name = svg.find_first_not_of(' ', next);
      element.attributes[svg.substr(name, quote - 1 - name)] =
          svg.substr(quote + 1, close - quote - 1);
      next = close + 1;
    }
    element.text = Unescaped(svg.substr(end + 1, svg.find('<', end) - end - 1));
    elements.push_back(std::move(element));
  }
  return elements;
}

std::string PictureDefect(const std::string& svg) {
  if (std::string defect = XmlDefect(svg); !defect.empty()) return defect;
  Ruler ruler;
  const std::vector<SvgElement> elements = ParseSvg(svg);
  const Eigen::Vector2d size(elements.front().Number("width"), elements.front().Number("height"));
  std::vector<std::pair<std::string, Box>> texts;
  for (const SvgElement& element : elements) {
    if (HasBadNumber(element)) return fmt::format("{} with a number that is none", element.name);
    const std::optional<Box> box = BoxOf(element, &ruler);
    if (!box) continue;
    if ((box->min.array() < -kSlack).any() || (box->max.array() > size.array() + kSlack).any()) {
      return fmt::format("{} '{}' from ({:.1f}, {:.1f}) to ({:.1f}, {:.1f}) leaves {} x {}",
                         element.name,
                         element.text,
                         box->min.x(),
                         box->min.y(),
                         box->max.x(),
                         box->max.y(),
                         size.x(),
                         size.y());
    }
    if (element.name != "text") continue;
    for (const auto& [text, other] : texts) {
      if (Overlap(*box, other)) {
        return fmt::format("'{}' overlaps '{}' at ({:.0f}, {:.0f})",
                           element.text,
                           text,
                           box->min.x(),
                           box->min.y());
      }
    }
    texts.emplace_back(element.text, *box);
  }
  return "";
}

double WidthInFont(const std::string& text, double size, bool bold) {
  return Ruler().Width(text, size, bold);
}

std::string TextsOf(const std::string& svg) {
  std::string texts;
  for (const SvgElement& element : ParseSvg(svg)) {
    if (element.name == "text") texts += element.text + "\n";
  }
  return texts;
}

int CountElements(const std::string& svg, const std::string& name) {
  const std::vector<SvgElement> elements = ParseSvg(svg);
  return static_cast<int>(std::count_if(
      elements.begin(), elements.end(), [&](const auto& element) { return element.name == name; }));
}

}  // namespace shiftmap::testing
