// SPDX-License-Identifier: Apache-2.0
#include "mapper/mapper_input.h"

#include <algorithm>
#include <functional>
#include <tuple>

namespace shiftmap {
namespace {

// A map of nothing but landmarks without signature has nothing to align a run by.
Status CheckPrior(const MapContent& prior) {
  if (prior.groups.empty() && !prior.anonymous_landmarks.empty()) {
    return InvalidArgument("prior map: {} landmarks, none with a signature to align a run by",
                           prior.anonymous_landmarks.size());
  }
  return OkStatus();
}

}  // namespace

Status CheckInputs(const std::vector<MapperInput>& inputs,
                   const std::optional<MapContent>& prior,
                   const MapperOptions& options) {
  SHIFTMAP_RETURN_IF_ERROR(options.Validate());
  for (const MapperInput& input : inputs) {
    SHIFTMAP_RETURN_IF_ERROR(Annotate(ValidateRun(input.run), "run '{}'", input.name));
  }
  return prior ? CheckPrior(*prior) : OkStatus();
}

void SortByBegin(std::vector<MapperInput>* inputs) {
  std::sort(inputs->begin(), inputs->end(), [](const MapperInput& a, const MapperInput& b) {
    return std::make_tuple(BeginOf(a.run), std::cref(a.sha256)) <
           std::make_tuple(BeginOf(b.run), std::cref(b.sha256));
  });
}

}  // namespace shiftmap
