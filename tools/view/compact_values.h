// SPDX-License-Identifier: Apache-2.0
//
// How the data document of the page writes values in few bytes.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <unordered_map>

#include "mapstore/cli/context.h"
#include "mapstore/core/stamp.h"
#include "mapstore/map/mode_chain.h"

namespace shiftmap {

inline constexpr double kMillimetre = 1e-3;
inline constexpr double kTenthMillimetre = 1e-4;

/// A value as a whole number of units.
/// Precondition: it is finite, and fits.
std::int64_t Scaled(double value, double unit);

/// Since the origin, rounded down. [ms]
std::int64_t Milliseconds(Stamp stamp, Stamp origin);

/// A value to so many digits, for few bytes.
double Rounded(double value, int digits);

/// A value to one decimal.
double Tenths(double value);

/// The leave rate of a uniform chain, or the rate matrix by rows, to six digits. [1/s]
Json RatesJson(const ModeChain& chain);

/// The period [s], then the rates of each phase by rows without the diagonal, to five digits. [1/s]
Json RhythmRatesJson(const ChainRhythm& rhythm);

/// Numbers texts in the order in which they come. The texts are inert; two that only differ in what
/// InertLine() changes have two numbers.
class TextTable {
 public:
  std::int64_t Add(const std::string& text);

  /// An array of the texts by their number. Call once, last.
  Json TakeJson() { return std::move(texts_); }

 private:
  std::unordered_map<std::string, std::int64_t> index_;
  Json texts_ = Json::array();
};

}  // namespace shiftmap
