// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/metrics.h"

#include <cstddef>

#include "mapstore/core/inert_text.h"

namespace shiftmap::server {
namespace {

// A label's value as the text format wants it.
std::string Escaped(const std::string& name) {
  const std::string text = InertLine(name);
  std::string escaped;
  for (const char c : text) {
    if (c == '\\' || c == '"') escaped += '\\';
    escaped += c == '\n' ? std::string("\\n") : std::string(1, c);
  }
  return escaped;
}

void AppendHead(const char* name, const char* type, const std::string& help, std::string* text) {
  *text += fmt::format("# HELP {} {}\n# TYPE {} {}\n", name, help, name, type);
}

}  // namespace

std::string CodeName(StatusCode code) { return absl::StatusCodeToString(code); }

void Metrics::CountCall(Call call, StatusCode code, double duration_s) {
  const std::lock_guard lock(mutex_);
  ++calls_[{call, code}];
  Durations& durations = durations_[call];
  for (std::size_t i = 0; i < kBins.size(); ++i) {
    if (duration_s <= kBins[i]) ++durations.bins[i];
  }
  ++durations.count;
  durations.sum_s += duration_s;
}

void Metrics::CountReport(const std::string& outcome) {
  const std::lock_guard lock(mutex_);
  ++reports_[outcome];
}

void Metrics::CountUploadedBytes(std::int64_t bytes) {
  const std::lock_guard lock(mutex_);
  uploaded_bytes_ += bytes;
}

std::int64_t Metrics::calls() const {
  const std::lock_guard lock(mutex_);
  std::int64_t sum = 0;
  for (const auto& [call, count] : calls_) sum += count;
  return sum;
}

void Metrics::AppendCalls(std::string* text) const {
  AppendHead("shiftmap_calls_total", "counter", "Calls by name and gRPC code.", text);
  for (const auto& [key, count] : calls_) {
    *text += fmt::format("shiftmap_calls_total{{call=\"{}\",code=\"{}\"}} {}\n",
                         NameOf(key.first),
                         CodeName(key.second),
                         count);
  }
  AppendHead("shiftmap_call_seconds", "histogram", "Durations of calls.", text);
  for (const auto& [call, durations] : durations_) {
    for (std::size_t i = 0; i < kBins.size(); ++i) {
      *text += fmt::format("shiftmap_call_seconds_bucket{{call=\"{}\",le=\"{}\"}} {}\n",
                           NameOf(call),
                           kBins[i],
                           durations.bins[i]);
    }
    *text += fmt::format(
        "shiftmap_call_seconds_bucket{{call=\"{0}\",le=\"+Inf\"}} {1}\n"
        "shiftmap_call_seconds_sum{{call=\"{0}\"}} {2}\n"
        "shiftmap_call_seconds_count{{call=\"{0}\"}} {1}\n",
        NameOf(call),
        durations.count,
        durations.sum_s);
  }
}

std::string Metrics::Text(const std::vector<Gauge>& gauges) const {
  std::string text;
  {
    const std::lock_guard lock(mutex_);
    AppendCalls(&text);
    AppendHead("shiftmap_reports_total", "counter", "Shift reports by outcome.", &text);
    for (const auto& [outcome, count] : reports_) {
      text += fmt::format("shiftmap_reports_total{{outcome=\"{}\"}} {}\n", outcome, count);
    }
    AppendHead("shiftmap_uploaded_bytes_total", "counter", "Bytes of run logs.", &text);
    text += fmt::format("shiftmap_uploaded_bytes_total {}\n", uploaded_bytes_);
  }
  for (const Gauge& gauge : gauges) {
    AppendHead(gauge.name.c_str(), "gauge", gauge.help, &text);
    for (const auto& [area, value] : gauge.by_area) {
      text += area.empty()
                  ? fmt::format("{} {}\n", gauge.name, value)
                  : fmt::format("{}{{area=\"{}\"}} {}\n", gauge.name, Escaped(area), value);
    }
  }
  return text;
}

}  // namespace shiftmap::server
