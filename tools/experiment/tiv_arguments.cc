// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/tiv_arguments.h"

namespace shiftmap {

void TivArguments::AddTo(Command* command) {
  command->Option("--output", &output, "Folder for CSV, JSON and SVG")
      .Required()
      .Option("--noise",
              &noise,
              "Noise that filters assume: printed in T-IV; matched to what is simulated; ideal, "
              "with Gaussian sightings instead of interest points")
      .OneOf({"printed", "matched", "ideal"})
      .Option("--motion", &motion, "T-IV (28), or the exact arc")
      .OneOf({"euler", "arc"})
      .Option("--errors", &errors, "Of EKF-SLAM: as printed, or invariant")
      .OneOf({"printed", "invariant"})
      .Option("--runs", &runs, "Simulated drives")
      .InRange(2, 100000)
      .Option("--length-m", &length_m, "Of the drift")
      .InRange(60.0, 1000.0)
      .Flag("--own-map",
            &own_map,
            "Each drive gets a map from a drive of its own: the errors of one map are the same in "
            "all drives on it")
      .Option("--threads", &threads, "Threads; the results do not depend on it")
      .InRange(1, 64)
      .Option("--seed", &seed, "Seed of the mine, and of the drives")
      .Writes();
}

TivOptions TivArguments::World() const {
  TivOptions options;
  options.noise = noise == "printed"   ? TivNoise::kPrinted
                  : noise == "matched" ? TivNoise::kMatched
                                       : TivNoise::kIdeal;
  options.seed = seed;
  options.length_m = length_m;
  options.euler = motion == "euler";
  options.errors =
      errors == "printed" ? SlamState::Errors::kPrinted : SlamState::Errors::kInvariant;
  return options;
}

StatusOr<TivWorld> TivArguments::WorldOf(const TivWorld& world, std::size_t run) const {
  if (!own_map) return world;
  constexpr std::uint64_t kMaps = 500'000'000;  // Apart from the seeds of drives.
  SHIFTMAP_ASSIGN_OR_RETURN(TreeSlam mapped, world.MapOriginal(kMaps + SeedOf(run)));
  return world.WithMap(std::move(mapped));
}

Json TivArguments::OptionsJson() const {
  return {{"noise", noise},
          {"motion", motion},
          {"errors", errors},
          {"runs", runs},
          {"length_m", length_m},
          {"map", own_map ? "own" : "shared"},
          {"seed", seed}};
}

}  // namespace shiftmap
