// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/nearest_name.h"

#include <gtest/gtest.h>

#include <tuple>

namespace shiftmap {
namespace {

TEST(NearestName, FindsWhatWasMeant) {
  const std::vector<std::string> names = {"--leave-rate-per-s",
                                          "--store",
                                          "--area",
                                          "--max-range-m",
                                          "versions",
                                          "verify",
                                          "L07",
                                          "L10"};
  const std::pair<const char*, const char*> cases[] = {
      {"--leve-rate", "--leave-rate-per-s"},
      {"--stroe", "--store"},
      {"-area", "--area"},
      {"range-m", "--max-range-m"},
      {"verson", "versions"},
      {"verfiy", "verify"},
      {"l07", "L07"},
  };
  for (const auto& [text, expected] : cases) EXPECT_EQ(NearestName(text, names), expected) << text;
}

TEST(NearestName, FindsNothingFarAway) {
  const std::vector<std::string> names = {"--store", "--area", "floor", "x"};
  for (const char* text : {"", "--", "--nonsense", "build", "q", "fl"}) {
    EXPECT_EQ(NearestName(text, names), std::nullopt) << text;
  }
  EXPECT_EQ(NearestName(std::string(100'000, 'a'), names), std::nullopt);
}

TEST(DidYouMean, IsTheEndOfAMessage) {
  EXPECT_EQ(DidYouMean("flor", {"floor"}), "; did you mean 'floor'?");
  EXPECT_EQ(DidYouMean("flor", {"hall"}), "");
  EXPECT_EQ(DidYouMean("fl\x1b[2J", {"fl\x1b[2K"}), "; did you mean 'fl\\x1b[2K'?");
}

}  // namespace
}  // namespace shiftmap
