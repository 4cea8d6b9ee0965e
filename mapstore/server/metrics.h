// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "mapstore/server/calls.h"
#include "proto/core/status.h"

namespace shiftmap::server {

/// A value that is read when it is asked for.
struct Gauge {
  std::string name;
  std::string help;
  std::vector<std::pair<std::string, double>> by_area;  ///< Area (empty: without) and value.
};

/// What the service counts, for Prometheus (text format 0.0.4). Threads: any.
class Metrics {
 public:
  void CountCall(Call call, StatusCode code, double duration_s);

  /// @param outcome  A word: "accepted", "duplicate", "refused", "failed".
  void CountReport(const std::string& outcome);

  void CountUploadedBytes(std::int64_t bytes);

  /// What was counted, and the gauges.
  std::string Text(const std::vector<Gauge>& gauges) const;

  std::int64_t calls() const;

 private:
  // Upper ends of the histogram's bins. [s]
  static constexpr std::array<double, 11> kBins = {
      0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.5, 1.0, 10.0, 60.0};

  struct Durations {
    std::array<std::int64_t, kBins.size()> bins = {};
    std::int64_t count = 0;
    double sum_s = 0.0;
  };

  void AppendCalls(std::string* text) const;

  mutable std::mutex mutex_;
  std::map<std::pair<Call, StatusCode>, std::int64_t> calls_;
  std::map<Call, Durations> durations_;
  // All from the start: of a series that begins with its first event nobody sees that it rose.
  std::map<std::string, std::int64_t> reports_ = {
      {"accepted", 0}, {"duplicate", 0}, {"failed", 0}, {"refused", 0}};
  std::int64_t uploaded_bytes_ = 0;
};

/// The name of a canonical code, as "NOT_FOUND".
std::string CodeName(StatusCode code);

}  // namespace shiftmap::server
