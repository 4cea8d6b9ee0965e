// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/client_places.h"

#include <gtest/gtest.h>

namespace shiftmap::live {
namespace {

using Clock = ClientActivity::Clock;

Clock::time_point At(double seconds) {
  return Clock::time_point() +
         std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
}

ClientActivity Guest(double last_s, bool has_spoken) {
  return {.last = At(last_s), .has_spoken = has_spoken};
}

ClientActivity Kept(double last_s) {
  return {.last = At(last_s), .has_spoken = true, .kept = true};
}

TEST(ClientPlacesTest, DriversAndListenersStayHoweverSilent) {
  EXPECT_FALSE(HasExpired(Kept(0.0), At(1e6)));
  EXPECT_FALSE(GuestToClose({Kept(0.0), Kept(5.0)}, At(1e6)));
}

TEST(ClientPlacesTest, GuestsAreClosedOnceSilentForLong) {
  EXPECT_FALSE(HasExpired(Guest(0.0, false), At(9.0)));
  EXPECT_TRUE(HasExpired(Guest(0.0, false), At(11.0)));
  EXPECT_FALSE(HasExpired(Guest(0.0, true), At(299.0)));
  EXPECT_TRUE(HasExpired(Guest(0.0, true), At(301.0)));
}

TEST(ClientPlacesTest, HalfAMessageIsNotWaitedForLong) {
  ClientActivity client = Kept(0.0);
  client.half_since = At(100.0);
  EXPECT_FALSE(HasExpired(client, At(104.0)));
  EXPECT_TRUE(HasExpired(client, At(106.0)));
}

TEST(ClientPlacesTest, TheGuestThatWasSilentLongestMakesRoom) {
  EXPECT_EQ(GuestToClose({Kept(0.0), Guest(3.0, true), Guest(2.0, false)}, At(9.0)), 2u);
  EXPECT_EQ(GuestToClose({Kept(0.0), Guest(3.0, true), Guest(4.0, false)}, At(9.0)), 1u);
}

TEST(ClientPlacesTest, AGuestHasTimeToAskAndToBeAnswered) {
  EXPECT_FALSE(GuestToClose({Guest(3.0, false)}, At(3.1)));
  EXPECT_EQ(GuestToClose({Guest(3.0, false)}, At(3.3)), 0u);
  EXPECT_EQ(GuestToClose({Guest(3.0, true)}, At(3.1)), 0u);
  ClientActivity owed = Guest(3.0, true);
  owed.is_owed = true;
  EXPECT_FALSE(GuestToClose({owed}, At(3.1)));
  EXPECT_EQ(GuestToClose({owed}, At(3.3)), 0u);
}

}  // namespace
}  // namespace shiftmap::live
