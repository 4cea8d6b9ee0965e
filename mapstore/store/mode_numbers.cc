// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/mode_numbers.h"

#include <utility>

namespace shiftmap {

StatusOr<ModeNumbers> ModeNumbers::Make(Database& database, std::int64_t version_id) {
  ModeNumbers numbers(version_id);
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement merged,
      database.Prepare("SELECT signature, number, into_number FROM merged_mode JOIN "
                       "landmark_group USING (version_id, group_index) WHERE version_id = ?1"));
  merged.Bind(version_id);
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, merged.Step());
    if (!row) return numbers;
    numbers.merged_[Signature(merged.Text(0))].push_back(
        {ModeNumber(merged.Int64(1)), ModeNumber(merged.Int64(2))});
  }
}

StatusOr<const LandmarkGroup*> ModeNumbers::Find(Database& database, const Signature& signature) {
  auto found = groups_.find(signature);
  if (found == groups_.end()) {
    LandmarkGroup group;
    SHIFTMAP_ASSIGN_OR_RETURN(
        Statement modes,
        database.Prepare("SELECT number FROM landmark_group CROSS JOIN mode USING (version_id, "
                         "group_index) WHERE version_id = ?1 AND signature = ?2 ORDER BY number"));
    modes.Bind(version_id_, signature.text());
    for (;;) {
      SHIFTMAP_ASSIGN_OR_RETURN(const bool row, modes.Step());
      if (!row) break;
      group.modes.emplace_back().number = ModeNumber(modes.Int64(0));
    }
    const auto merged = merged_.find(signature);
    if (merged != merged_.end()) group.merged = merged->second;
    found = groups_.emplace(signature, std::move(group)).first;
  }
  return found->second.modes.empty() ? nullptr : &found->second;
}

}  // namespace shiftmap
