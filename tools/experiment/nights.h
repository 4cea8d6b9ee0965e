// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "proto/core/status.h"
#include "tools/experiment/nights_world.h"

namespace shiftmap {

/// Probabilities of the true states of landmarks that the vehicle with the fault visited, and
/// others after it.
struct RecoveryCount {
  int states = 0;
  int wrong_likeliest = 0;
  int doubtful = 0;  ///< True states below 0.95.
  double p_true_min = 1.0;
};

/// A day of shifts and the night after it.
struct NightResult {
  int night = 0;  ///< From 1.

  // The day, on the map of the night before. A shift with a fault does not count.
  int shifts = 0;
  int localized = 0;
  int wrong_starts = 0;      ///< The first pose was off by a metre or more.
  double start_s_sum = 0.0;  ///< From the begin of a shift to its first pose. [s]
  double rmse_m = 0.0;       ///< Of the poses, the map aligned with the truth; NaN: none.
  int decisions = 0;
  int wrong_decisions = 0;  ///< The landmark stood elsewhere.

  // When the shifts of the day began: landmarks whose true state the map has.
  int states = 0;
  double p_true_sum = 0.0;
  double log_p_true_sum = 0.0;
  int wrong_likeliest = 0;
  int sure = 0;        ///< A state held at odds of more than 20 to 1,
  int wrong_sure = 0;  ///< and it was another one.
  int new_places = 0;  ///< Of landmarks: the map does not have where they stand.

  // Landmarks at the end of each shift without a fault that visited them: it was the first vehicle
  // to do so since the one with the fault, or a later one.
  RecoveryCount after_one;
  RecoveryCount after_two;

  // The map that the night made.
  int modes = 0;
  int wrong_modes = 0;      ///< 0.3 m or more from every place of their landmark.
  double map_rmse_m = 0.0;  ///< Of the other modes.
  double frame_shift_m =
      0.0;  ///< Of the map's frame since the first night, at the landmarks' centre,
  double frame_turn_rad = 0.0;  ///< and its turn.
  int unmapped = 0;             ///< Runs up to now that the map does not have,
  int waiting = 0;              ///< and those of them that wait.
  int waited_nights = 0;        ///< The longest of them.
  bool published = false;       ///< What the night built.
  int held = 0;                 ///< Runs that are held or excluded.
  double night_s = 0.0;         ///< On the wall, of all areas.
  double store_mib = 0.0;
};

/// A landmark that was removed, and from when on the map said so.
struct Removal {
  Signature signature;
  int removed_run = 0;
  double absent_after_days = 0.0;  ///< `absent` had more than one half; NaN: never in this time.
};

struct NightsResult {
  std::vector<NightResult> nights;
  std::vector<Removal> removals;
};

/// The area of a site, and its store in the folder of DriveNights.
inline constexpr char kSiteArea[] = "site";
std::string SiteStore(const std::string& folder);

/// Drives the days and nights of a site with the commands that a site uses: `run` on the published
/// map for each shift, whose log and report go into a folder, and `nightly` at the end of a day.
/// @param folder       Where logs, reports, the store and, in `world`, the truth go; must not
/// exist.
/// @param night_words  More arguments of `nightly`.
/// @param progress     Called after each night.
/// Errors: what a command said that did not end as it should.
StatusOr<NightsResult> DriveNights(const NightsOptions& options,
                                   const std::string& folder,
                                   const std::vector<std::string>& night_words,
                                   const std::function<void(const NightResult&)>& progress);

/// The same of several sites that share a store, one area each, `area-00` and so on: one `nightly`
/// a night maps them all.
/// @param sites     As many nights each.
/// @param progress  Called after each night with the results of all sites.
StatusOr<std::vector<NightsResult>> DriveFleet(
    const std::vector<NightsOptions>& sites,
    const std::string& folder,
    const std::vector<std::string>& night_words,
    const std::function<void(const std::vector<NightsResult>&)>& progress);

}  // namespace shiftmap
