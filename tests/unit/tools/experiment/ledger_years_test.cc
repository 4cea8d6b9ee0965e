// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/ledger_years.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/temp_dir.h"

namespace shiftmap::testing {
namespace {

// The oracle is the store that keeps all rows.
TEST(LedgerYears, SummedUpAYearSaysWhatItsRowsSaid) {
  const TempDir dir;
  LedgerYearsOptions options;
  options.groups = 8;
  options.vehicles = 3;
  options.visits_per_day = 2.0;
  options.stay_days = 30.0;
  const auto summed = RunLedgerYears(options, dir.File("summed.db"), [](double) {});
  options.compacts = false;
  const auto full = RunLedgerYears(options, dir.File("all.db"), [](double) {});
  ASSERT_TRUE(summed.ok());
  ASSERT_TRUE(full.ok());
  const LedgerYear& all = full->front();
  const LedgerYear& few = summed->front();
  EXPECT_EQ(all.visits, few.visits);
  EXPECT_EQ(all.rows, all.visits);
  EXPECT_LT(few.rows, 0.5 * all.rows);
  EXPECT_LT(few.store_mib, all.store_mib);
  ASSERT_EQ(all.rates.size(), few.rates.size());
  for (std::size_t i = 0; i < all.rates.size(); ++i) {
    EXPECT_NEAR(few.rates[i] / all.rates[i], 1.0, 0.05) << i;
  }
  // The past is seen with hindsight, but for the last month.
  ASSERT_EQ(all.probabilities.size(), few.probabilities.size());
  double difference = 0.0;
  for (std::size_t i = 0; i < all.probabilities.size(); ++i) {
    difference += std::abs(few.probabilities[i] - all.probabilities[i]);
  }
  EXPECT_LT(difference / static_cast<double>(all.probabilities.size()), 0.05);
}

TEST(LedgerYears, AnotherSeedDrawsOtherVisits) {
  const TempDir dir;
  LedgerYearsOptions options;
  options.groups = 8;
  options.vehicles = 3;
  options.visits_per_day = 0.1;
  const auto first = RunLedgerYears(options, dir.File("first.db"), [](double) {});
  ++options.seed;
  const auto second = RunLedgerYears(options, dir.File("second.db"), [](double) {});
  ASSERT_TRUE(first.ok());
  ASSERT_TRUE(second.ok());
  EXPECT_NE(first->front().visits, second->front().visits);
}

}  // namespace
}  // namespace shiftmap::testing
