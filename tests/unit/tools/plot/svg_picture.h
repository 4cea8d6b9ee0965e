// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>
#include <vector>

#include "mapstore/map/map_snapshot.h"

namespace shiftmap::testing {

/// A map of the landmarks, whose positions are independent.
MapSnapshot MapOf(const std::string& area, int version, MapContent content);

/// An element of a picture, and the text inside it.
struct SvgElement {
  std::string name;
  std::map<std::string, std::string> attributes;
  std::string text;

  double Number(const std::string& attribute) const;
};

/// All elements in their order. Precondition: well-formed.
std::vector<SvgElement> ParseSvg(const std::string& svg);

/// What is wrong with a picture; empty if nothing is: it is not well-formed, has a number that is
/// none, an element that leaves the picture, or two texts that overlap. Texts are measured in the
/// font that the picture names.
std::string PictureDefect(const std::string& svg);

/// How wide the font that pictures name sets a text. [px]
double WidthInFont(const std::string& text, double size, bool bold);

/// The texts of a picture, one per line.
std::string TextsOf(const std::string& svg);

/// How many elements have that name.
int CountElements(const std::string& svg, const std::string& name);

}  // namespace shiftmap::testing
