// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/experiments.h"

#include "tools/experiment/alignments_command.h"
#include "tools/experiment/engines_command.h"
#include "tools/experiment/fleet_nights_command.h"
#include "tools/experiment/groupings_command.h"
#include "tools/experiment/ijrr_selectors_command.h"
#include "tools/experiment/ijrr_utias_command.h"
#include "tools/experiment/layout_pairs_command.h"
#include "tools/experiment/ledger_years_command.h"
#include "tools/experiment/lidar_repeatability_command.h"
#include "tools/experiment/lidar_run_command.h"
#include "tools/experiment/localizer_bodies_command.h"
#include "tools/experiment/localizer_consistency_command.h"
#include "tools/experiment/localizer_decisions_command.h"
#include "tools/experiment/localizer_recorded_command.h"
#include "tools/experiment/localizer_states_command.h"
#include "tools/experiment/localizer_utias_command.h"
#include "tools/experiment/map_consistency_command.h"
#include "tools/experiment/nights_command.h"
#include "tools/experiment/papers_command.h"
#include "tools/experiment/recurring_chains_command.h"
#include "tools/experiment/scale_command.h"
#include "tools/experiment/tiv_approximations_command.h"
#include "tools/experiment/tiv_mine_command.h"
#include "tools/experiment/tiv_removal_command.h"
#include "tools/experiment/vehicle_faults_command.h"
#include "tools/experiment/victoria_park_command.h"

namespace shiftmap {

void AddExperiments(Application* application) {
  AddAlignmentsExperiment(application);
  AddEnginesExperiment(application);
  AddFleetNightsExperiment(application);
  AddGroupingsExperiment(application);
  AddIjrrSelectorsExperiment(application);
  AddIjrrUtiasExperiment(application);
  AddLayoutPairsExperiment(application);
  AddLedgerYearsExperiment(application);
  AddLidarRepeatabilityExperiment(application);
  AddLidarRunExperiment(application);
  AddLocalizerBodiesExperiment(application);
  AddLocalizerConsistencyExperiment(application);
  AddLocalizerDecisionsExperiment(application);
  AddLocalizerRecordedExperiment(application);
  AddLocalizerUtiasExperiment(application);
  AddLocalizerStatesExperiment(application);
  AddMapConsistencyExperiment(application);
  AddNightsExperiment(application);
  AddPapersCommand(application);
  AddRecurringChainsExperiment(application);
  AddScaleExperiment(application);
  AddTivApproximationsExperiment(application);
  AddTivMineExperiments(application);
  AddTivRemovalExperiment(application);
  AddVehicleFaultsExperiment(application);
  AddVictoriaParkExperiment(application);
}

}  // namespace shiftmap
