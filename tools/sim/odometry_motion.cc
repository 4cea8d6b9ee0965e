// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/odometry_motion.h"

#include <cmath>

namespace shiftmap {

Se2 TrueMotion(const Velocity& logged,
               double seconds,
               const OdometryCalibration& odometry,
               Random* random) {
  const double root = std::sqrt(seconds);
  const double along = Gaussian(odometry.noise_v * root, random);
  const double across = Gaussian(odometry.noise_v * root, random);
  const double turn = Gaussian(odometry.noise_omega * root, random);
  return Se2::Exp({odometry.scale_v * logged.v_mps * seconds + along,
                   across,
                   odometry.scale_omega * logged.omega_radps * seconds + turn});
}

}  // namespace shiftmap
