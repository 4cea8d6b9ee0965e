// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>

#include "mapstore/run/item_limits.h"
#include "mapstore/run/run.h"
#include "tools/convert/check/finding.h"

namespace shiftmap {

/// Which landmarks scans saw, how often, and whether numbers can be ranges and bearings.
class ScanCheck {
 public:
  explicit ScanCheck(const ItemLimits& limits) : limits_(limits) {}

  void Add(const Scan& scan);
  void Report(Stamp begin, Findings* findings) const;

  std::int64_t observations() const { return observations_; }
  std::int64_t anonymous() const { return anonymous_; }
  std::int64_t empty_scans() const { return empty_scans_; }
  std::int64_t signatures() const { return static_cast<std::int64_t>(counts_.size()); }
  std::int64_t seen_once() const;

 private:
  /// A log with more has signatures at random, and is not counted further.
  static constexpr std::size_t kMaxSignatures = 100'000;

  void AddObservation(const Observation& observation, Stamp stamp);
  void FindDoubles(const Scan& scan);
  void ReportSignatures(Stamp begin, Findings* findings) const;
  void ReportUnits(Findings* findings) const;

  ItemLimits limits_;
  std::int64_t scans_ = 0;
  std::int64_t empty_scans_ = 0;
  std::int64_t observations_ = 0;
  std::int64_t anonymous_ = 0;
  std::int64_t implausible_ = 0;
  std::optional<Stamp> first_implausible_;
  std::int64_t polar_ = 0;
  std::int64_t beyond_circle_ = 0;  // Bearings outside of ±2π.
  std::int64_t far_ = 0;            // Ranges that are usual in millimetres.
  std::map<std::string, std::int64_t> counts_;
  std::int64_t doubles_ = 0;
  std::optional<Stamp> first_double_;
  std::set<std::string> double_names_;
};

}  // namespace shiftmap
