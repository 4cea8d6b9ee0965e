// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "mapstore/cli/application.h"
#include "tools/experiment/nights_world.h"

namespace shiftmap {

/// What experiments with simulated sites are told.
struct SiteArguments {
  std::string output;
  std::string work;
  int worlds = 2;
  int control_points = 0;  ///< Of a second copy of each site; 0: no copies.
  int judge_shifts = 12;   ///< As `nightly --judge-shifts`.
  NightsOptions nights;
};

/// The options that such experiments have in common: folders, sites, vehicles, landmarks, shifts.
void AddSiteOptions(SiteArguments* arguments, Command* command);

/// `nights`: days and nights of simulated sites, through the commands of a site (nights.h).
void AddNightsExperiment(Application* application);

}  // namespace shiftmap
