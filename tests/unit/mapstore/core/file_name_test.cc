// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/file_name.h"

#include <gtest/gtest.h>

#include <set>

#include "mapstore/core/hex.h"

namespace shiftmap {
namespace {

TEST(FileNameTest, APlainNameStays) { EXPECT_EQ(FileNameOf("Level-3_b.old"), "Level-3_b.old"); }

TEST(FileNameTest, NamesThatDifferAreDifferentInertFiles) {
  const std::string long_name(300, 'x');
  const std::set<std::string> names = {"",
                                       ".",
                                       "..",
                                       "../etc",
                                       "/etc",
                                       "a/b",
                                       "a=2Fb",
                                       "a\nb",
                                       "\x1b[31m",
                                       "<b>",
                                       "=",
                                       "Ebene ä",
                                       "a b",
                                       "-rf",
                                       long_name,
                                       long_name + "y",
                                       std::string("a\0b", 3)};
  std::set<std::string> files;
  for (const std::string& name : names) {
    const std::string file = FileNameOf(name);
    EXPECT_TRUE(files.insert(file).second) << file;
    EXPECT_LE(file.size(), 100u);
    EXPECT_FALSE(file.empty() || file.front() == '.') << file;
    for (const char c : file) {
      EXPECT_TRUE(std::isalnum(static_cast<unsigned char>(c)) ||
                  std::string(".=_-").find(c) != std::string::npos)
          << file;
    }
  }
}

TEST(HexTest, BytesComeBack) {
  std::string bytes;
  for (int i = 0; i < 256; ++i) bytes += static_cast<char>(i);
  EXPECT_EQ(FromHex(ToHex(bytes)), bytes);
  EXPECT_EQ(ToHex("\x01\xfe"), "01fe");
  EXPECT_EQ(FromHex("0"), std::nullopt);
  EXPECT_EQ(FromHex("0x"), std::nullopt);
}

}  // namespace
}  // namespace shiftmap
