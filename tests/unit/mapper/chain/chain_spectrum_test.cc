// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/chain_spectrum.h"

#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <random>

#include "mapper/chain/gap_integral.h"
#include "mapstore/map/mode_chain.h"
#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"

namespace shiftmap::testing {
namespace {

ModeChain ChainOf(Eigen::MatrixXd rates) {
  rates.diagonal().setZero();
  rates.diagonal() = -rates.rowwise().sum();
  return *ModeChain::FromRates(rates);
}

// The oracles are exponentials.
TEST(ChainSpectrumTest, AgreesWithExponentials) {
  std::mt19937_64 random(TestSeed(3));
  std::uniform_real_distribution<double> exponent(-8.0, -3.0);
  std::uniform_real_distribution<double> weight(0.0, 1.0);
  int used = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const int states = 2 + trial % 6;
    Eigen::MatrixXd rates(states, states);
    for (double& rate : rates.reshaped()) rate = std::pow(10.0, exponent(random));
    const ModeChain chain = ChainOf(rates);
    std::optional<ChainSpectrum> spectrum = ChainSpectrum::Of(chain.rate_matrix());
    if (!spectrum) continue;
    ++used;
    Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(states, states);
    double total = 0.0;
    for (const double length : {1.0, 600.0, 1e4, 1e6, 1e8}) {
      EXPECT_THAT(spectrum->Transition(length),
                  IsNearMatrix(chain.Transition(FromSeconds(length)), 1e-11));
      Eigen::MatrixXd weights(states, states);
      for (double& entry : weights.reshaped()) entry = weight(random);
      expected += GapIntegral(chain.rate_matrix(), length, weights);
      total += length;
      spectrum->AddIntegral(length, weights);
      EXPECT_THAT(Eigen::MatrixXd(spectrum->Sum() / total),
                  IsNearMatrix(Eigen::MatrixXd(expected / total), 1e-9))
          << trial << ", " << length << " s";
    }
  }
  EXPECT_GT(used, 180);
}

// Eigenvalues that are equal, and complex ones.
TEST(ChainSpectrumTest, RoundsAndRepetitions) {
  Eigen::MatrixXd around = Eigen::MatrixXd::Zero(3, 3);
  around(0, 1) = around(1, 2) = around(2, 0) = 1e-4;
  Eigen::MatrixXd alike = Eigen::MatrixXd::Constant(4, 4, 1e-5);
  alike(0, 1) = 3e-5;
  for (const Eigen::MatrixXd& rates : {around, alike}) {
    const ModeChain chain = ChainOf(rates);
    std::optional<ChainSpectrum> spectrum = ChainSpectrum::Of(chain.rate_matrix());
    ASSERT_TRUE(spectrum);
    const Eigen::MatrixXd weights = Eigen::MatrixXd::Ones(rates.rows(), rates.cols());
    spectrum->AddIntegral(3e4, weights);
    EXPECT_THAT(
        Eigen::MatrixXd(spectrum->Sum() / 3e4),
        IsNearMatrix(Eigen::MatrixXd(GapIntegral(chain.rate_matrix(), 3e4, weights) / 3e4), 1e-10));
    EXPECT_THAT(spectrum->Transition(3e4), IsNearMatrix(chain.Transition(FromSeconds(3e4)), 1e-12));
  }
}

// 0 to 1 to 2 at one rate: two eigenvectors are one.
TEST(ChainSpectrumTest, EigenvectorsThatAreOneAreRefused) {
  Eigen::MatrixXd rates = Eigen::MatrixXd::Zero(3, 3);
  rates(0, 1) = rates(1, 2) = 1e-4;
  EXPECT_FALSE(ChainSpectrum::Of(ChainOf(rates).rate_matrix()));
  EXPECT_FALSE(ChainSpectrum::Of(
      ChainOf(Eigen::MatrixXd::Constant(ChainSpectrum::kMaxStates + 1, 11, 1e-4)).rate_matrix()));
}

}  // namespace
}  // namespace shiftmap::testing
