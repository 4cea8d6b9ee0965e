// SPDX-License-Identifier: Apache-2.0
#include "mapper/mapper_options.h"

#include <cmath>
#include <vector>

#include "mapstore/map/map_snapshot.h"

namespace shiftmap {
namespace {

constexpr double kMaxDurationS = 1e9;  // Decades; stamps hold 292 years.

enum class Range { kPositive, kNotNegative, kProbability, kOneOrMore, kDuration };

struct Member {
  template <typename Number>
  Member(const char* of, Number number, Range in)
      : name(of), value(static_cast<double>(number)), range(in) {}

  const char* name;
  double value;
  Range range;
};

bool IsIn(Range range, double value) {
  if (!std::isfinite(value)) return false;
  switch (range) {
    case Range::kPositive:
      return value > 0.0;
    case Range::kNotNegative:
      return value >= 0.0;
    case Range::kProbability:
      return value > 0.0 && value < 1.0;
    case Range::kOneOrMore:
      return value >= 1.0;
    case Range::kDuration:
      return value > 0.0 && value <= kMaxDurationS;
  }
  return false;
}

const char* ToString(Range range) {
  switch (range) {
    case Range::kPositive:
      return "> 0";
    case Range::kNotNegative:
      return "0 or more";
    case Range::kProbability:
      return "between 0 and 1";
    case Range::kOneOrMore:
      return "1 or more";
    case Range::kDuration:
      return "> 0 s and at most 1e9 s";
  }
  return "";
}

}  // namespace

Status MapperOptions::Validate() const {
  std::vector<Member> members = {
      {"visit_gap_s", front_end.visit_gap_s, Range::kDuration},
      {"duplicate_distance_m", front_end.duplicate_distance_m, Range::kNotNegative},
      {"min_range_m", front_end.min_range_m, Range::kNotNegative},
      {"min_way_m", front_end.moving.min_way_m, Range::kPositive},
      {"max_time_s", front_end.moving.max_time_s, Range::kDuration},
      {"moved_share", front_end.moving.moved_share, Range::kPositive},
      {"min_moves", front_end.moving.min_moves, Range::kOneOrMore},
      {"min_moves_per_standing", front_end.moving.min_moves_per_standing, Range::kNotNegative},
      {"alignment position_floor_m", alignment.position_floor_m, Range::kPositive},
      {"max_scale_error", alignment.max_scale_error, Range::kNotNegative},
      {"gate_probability", alignment.gate_probability, Range::kProbability},
      {"deformed_sd_m", alignment.deformed_sd_m, Range::kPositive},
      {"part_modes", alignment.part_modes, Range::kOneOrMore},
      {"max_pairs", alignment.max_pairs, Range::kOneOrMore},
      {"confirmation min_share", confirmation.min_share, Range::kNotNegative},
      {"confirmation min_probability", confirmation.min_probability, Range::kProbability},
      {"min_probability_of_most", confirmation.min_probability_of_most, Range::kProbability},
      {"false_misfit", confirmation.false_misfit, Range::kProbability},
      {"mistaken_distance_ratio", confirmation.mistaken_distance_ratio, Range::kOneOrMore},
      {"none_stayed", confirmation.prior.none_stayed, Range::kProbability},
      {"near_share", confirmation.prior.near_share, Range::kProbability},
      {"group_share", confirmation.prior.group_share, Range::kNotNegative},
      {"group_continue", confirmation.prior.group_continue, Range::kProbability},
      {"scattered_share", confirmation.prior.scattered_share, Range::kProbability},
      {"body_apart", confirmation.prior.body_apart, Range::kProbability},
      {"exchange_share", confirmation.prior.exchange_share, Range::kProbability},
      {"same_heading_sd_rad", confirmation.prior.same_heading_sd_rad, Range::kPositive},
      {"slot_sd_m", confirmation.prior.slot_sd_m, Range::kPositive},
      {"exchange_sd_m", confirmation.prior.exchange_sd_m, Range::kPositive},
      {"exchange_heading_sd_rad", confirmation.prior.exchange_heading_sd_rad, Range::kPositive},
      {"confirmation sd_scale", confirmation.prior.sd_scale, Range::kPositive},
      {"same_frame_m", confirmation.limits.same_frame_m, Range::kPositive},
      {"probability_displaced", displacement.prior.probability_displaced, Range::kProbability},
      {"probability_with_neighbour",
       displacement.prior.probability_with_neighbour,
       Range::kProbability},
      {"others_anywhere", displacement.prior.others_anywhere, Range::kPositive},
      {"neighbourhood", displacement.prior.neighbourhood, Range::kPositive},
      {"map_variance_dof", displacement.map_variance_dof, Range::kPositive},
      {"displacement position_floor_m", displacement.position_floor_m, Range::kPositive},
      {"sure_sds", displacement.sure_sds, Range::kPositive},
      {"stiff_sd_m", deformation.stiff_sd_m, Range::kNotNegative},
      {"max_linear_m", deformation.max_linear_m, Range::kPositive},
      {"first_max_sd_m", deformation.first_max_sd_m, Range::kPositive},
      {"last_max_sd_m", deformation.last_max_sd_m, Range::kPositive},
      {"contradiction", deformation.contradiction, Range::kProbability},
      {"deformation variance_factor", deformation.variance_factor, Range::kOneOrMore},
      {"max_bearing_offset_rad", plausibility.max_bearing_offset_rad, Range::kPositive},
      {"max_scale", plausibility.max_scale, Range::kOneOrMore},
      {"max_noise_omega", plausibility.max_noise_omega, Range::kPositive},
      {"max_noise_v", plausibility.max_noise_v, Range::kPositive},
      {"max_sd_bearing_rad", plausibility.max_sd_bearing_rad, Range::kPositive},
      {"reversed_log_odds", plausibility.reversed_log_odds, Range::kPositive},
      {"max_outliers", plausibility.max_outliers, Range::kProbability},
      {"min_visits", relocation.min_visits, Range::kOneOrMore},
      {"part_visits", relocation.part_visits, Range::kOneOrMore},
      {"same_place_m", relocation.same_place_m, Range::kPositive},
      {"max_turn_rad", relocation.max_turn_rad, Range::kNotNegative},
      {"prior_dof", disagreement.prior_dof, Range::kPositive},
      {"outlier_probability", disagreement.outlier_probability, Range::kProbability},
      {"expected_mean_square", disagreement.expected_mean_square, Range::kPositive},
      {"min_modes", disagreement.min_modes, Range::kOneOrMore},
      {"min_sightings", modes.min_sightings, Range::kOneOrMore},
      {"cluster_radius_m", modes.cluster_radius_m, Range::kPositive},
      {"position_floor_m", modes.position_floor_m, Range::kPositive},
      {"merge_probability", modes.merge_probability, Range::kProbability},
      {"max_merge_sd_m", modes.max_merge_sd_m, Range::kPositive},
      {"leave_rate_per_s", modes.leave_rate_per_s, Range::kNotNegative},
      {"score_position_sd_m", modes.score_position_sd_m, Range::kPositive},
      {"misread_density_per_m2", modes.misread_density_per_m2, Range::kPositive},
      {"one_sided_probability", missed.one_sided_probability, Range::kProbability},
      {"detection_concentration", missed.detection_concentration, Range::kPositive},
      {"sd_range_scale", sd_range_scale, Range::kNotNegative},
      {"sd_run_range_scale", sd_run_range_scale, Range::kNotNegative},
      {"sd_bearing_offset_rad", sd_bearing_offset_rad, Range::kPositive},
      {"sd_range_curvature_per_rad2", sd_range_curvature_per_rad2, Range::kPositive},
      {"distortion_share", distortion_share, Range::kNotNegative},
      {"loss_reach_sds", loss_reach_sds, Range::kPositive},
      {"max_outer_iterations", max_outer_iterations, Range::kOneOrMore},
      {"max_iterations", solver.max_iterations, Range::kOneOrMore},
      {"cost_tolerance", solver.cost_tolerance, Range::kPositive},
      {"max_integrations", max_integrations, Range::kOneOrMore},
      {"threads", threads, Range::kOneOrMore},
      {"clock_tolerance_s", clock_tolerance_s, Range::kNotNegative},
      {"max_memory_bytes", max_memory_bytes, Range::kNotNegative},
  };
  for (const double sd : displacement.sd_displacement_m) {
    members.push_back({"sd_displacement_m", sd, Range::kPositive});
  }
  for (const double factor : displacement.run_variance_factors) {
    members.push_back({"run_variance_factors", factor, Range::kPositive});
  }
  for (const Member& member : members) {
    if (IsIn(member.range, member.value)) continue;
    return InvalidArgument(
        "{}: {}, expected {}", member.name, member.value, ToString(member.range));
  }
  if (alignment.min_signatures < 2) {
    return InvalidArgument("min_signatures: {}, expected 2 or more", alignment.min_signatures);
  }
  SHIFTMAP_RETURN_IF_ERROR(ValidateCalibration(calibration));
  SHIFTMAP_RETURN_IF_ERROR(modes.selector.Validate());
  SHIFTMAP_RETURN_IF_ERROR(chains.learning.Validate());
  return association.Validate();
}

}  // namespace shiftmap
