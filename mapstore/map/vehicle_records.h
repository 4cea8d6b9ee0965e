// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>

namespace shiftmap {

/// Prior probability that what a vehicle says of a landmark is a mistake, until another vehicle
/// speaks of it: misread codes, an odometer that slips, a lie. That of a vehicle of which nothing
/// is known.
inline constexpr double kMistakeProbability = 1e-3;

/// What the first visit of another vehicle says of a vehicle's turn about a landmark.
struct TurnVerdict {
  std::int64_t vehicle = 0;   ///< VehicleKey of the name of the vehicle whose turn it was.
  double mistaken = 0.0;      ///< Probability that the turn was a mistake.
  double bayes_factor = 1.0;  ///< Of mistaken over right, without the prior; > 0.
};

/// How far each vehicle of a fleet is trusted while evidence is filtered, learned from verdicts.
///
/// A vehicle works or is broken; one that works makes mistakes in half of kMistakeProbability of
/// its turns, a broken one in nine of ten. With b the probability that it is broken and B the Bayes
/// factor of a verdict,
///
///   b <- b - κ (b - b₀),   odds of b <- odds of b · (0.1 + 0.9 B) / (1 - ε₀ + ε₀ B)
///
/// κ = 0.01: vehicles are repaired, and break. b₀ makes the probability of a mistake of a vehicle
/// without verdicts kMistakeProbability.
class VehicleRecords {
 public:
  /// Of the next turn, and of turns that no verdict has been passed on.
  double MistakeProbability(std::int64_t vehicle) const;

  void Add(const TurnVerdict& verdict);

  /// Probability that it is broken, by VehicleKey; those without a verdict are not there.
  const std::map<std::int64_t, double>& broken() const { return broken_; }

  /// @param broken  In (0, 1).
  void Set(std::int64_t vehicle, double broken) { broken_[vehicle] = broken; }

  bool operator==(const VehicleRecords&) const = default;

 private:
  std::map<std::int64_t, double> broken_;
};

}  // namespace shiftmap
