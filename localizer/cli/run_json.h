// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "localizer/hypothesis/hypothesis_view.h"
#include "localizer/localizer.h"
#include "mapstore/cli/context.h"
#include "mapstore/store_types.h"

namespace shiftmap {

/// What `run` says about a shift beside what the localizer knows.
struct RunSummary {
  std::vector<double> latencies_ms;  ///< Of each scan.
  std::string truncation;            ///< As RunLog::truncation.
  std::string vehicle;               ///< Empty if nothing names it.
  std::string report_uuid;
  std::optional<ReturnResult> returned;      ///< What the store made of it, if it was handed in.
  std::optional<HypothesisView> hypotheses;  ///< After the last item; nothing without a pose.
  std::set<Signature> signatures;            ///< That were seen.
  std::size_t known_signatures = 0;          ///< Of these, the map has as many.
};

/// The document of `run --json`; its keys are fixed.
Json RunJson(const Localizer& localizer, const RunSummary& summary);

/// The same for people.
std::string RunText(const Localizer& localizer, const RunSummary& summary);

}  // namespace shiftmap
