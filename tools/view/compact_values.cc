// SPDX-License-Identifier: Apache-2.0
#include "tools/view/compact_values.h"

#include <Eigen/Core>
#include <chrono>
#include <cmath>

#include "mapstore/core/inert_text.h"

namespace shiftmap {
std::int64_t Scaled(double value, double unit) { return std::llround(value / unit); }

std::int64_t Milliseconds(Stamp stamp, Stamp origin) {
  return std::chrono::floor<std::chrono::milliseconds>(stamp - origin).count();
}

double Rounded(double value, int digits) {
  return std::stod(fmt::format("{:.{}g}", value, digits));
}

double Tenths(double value) { return std::round(value * 10.0) / 10.0; }

Json RatesJson(const ModeChain& chain) {
  constexpr int kDigits = 6;
  if (chain.uniform()) return Rounded(chain.leave_rate_per_s(), kDigits);
  Json rates = Json::array();
  for (Eigen::Index from = 0; from < chain.states(); ++from) {
    for (Eigen::Index to = 0; to < chain.states(); ++to) {
      rates.push_back(Rounded(chain.rate_matrix()(from, to), kDigits));
    }
  }
  return rates;
}

Json RhythmRatesJson(const ChainRhythm& rhythm) {
  constexpr int kDigits = 5;
  Json json = {ToSeconds(rhythm.calendar().period)};
  for (const Eigen::MatrixXd& rates : rhythm.rate_matrices()) {
    for (Eigen::Index from = 0; from < rates.rows(); ++from) {
      for (Eigen::Index to = 0; to < rates.cols(); ++to) {
        if (from != to) json.push_back(Rounded(rates(from, to), kDigits));
      }
    }
  }
  return json;
}

std::int64_t TextTable::Add(const std::string& text) {
  const auto [entry, is_new] = index_.try_emplace(text, static_cast<std::int64_t>(index_.size()));
  if (is_new) texts_.push_back(InertLine(text));
  return entry->second;
}

}  // namespace shiftmap
