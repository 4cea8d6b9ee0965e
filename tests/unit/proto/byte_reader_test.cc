// SPDX-License-Identifier: Apache-2.0
#include "proto/mcap/byte_reader.h"

#include <gtest/gtest.h>

#include "proto/mcap/byte_writer.h"
#include "proto/mcap/crc32.h"

namespace shiftmap::mcap {
namespace {

TEST(ByteReader, ReadsLittleEndian) {
  ByteReader reader(std::string_view("\x01\x02\x03\xff\xfe\x00\x00\x80", 8));
  EXPECT_EQ(reader.Read<std::uint16_t>(), 0x0201);
  EXPECT_EQ(reader.Read<std::uint8_t>(), 0x03);
  EXPECT_EQ(reader.Read<std::uint8_t>(), 0xff);
  EXPECT_EQ(reader.Read<std::uint32_t>(), 0x800000feU);
  EXPECT_TRUE(reader.ok());
  EXPECT_TRUE(reader.rest().empty());
}

TEST(ByteReader, ReadsBackWhatAByteWriterWrote) {
  ByteWriter writer;
  writer.Write(std::uint8_t{7})
      .Write(std::uint64_t{0x0123456789abcdef})
      .String("name")
      .Bytes("rest");
  ByteReader reader(writer.bytes());
  EXPECT_EQ(reader.Read<std::uint8_t>(), 7);
  EXPECT_EQ(reader.Read<std::uint64_t>(), 0x0123456789abcdefU);
  EXPECT_EQ(reader.String(), "name");
  EXPECT_EQ(reader.rest(), "rest");
  EXPECT_TRUE(reader.ok());
}

TEST(ByteReader, StaysNotOkAfterReadingBeyondTheEnd) {
  ByteReader reader("abc");
  EXPECT_EQ(reader.Read<std::uint32_t>(), 0U);
  EXPECT_FALSE(reader.ok());
  EXPECT_EQ(reader.Read<std::uint8_t>(), 0);
  EXPECT_EQ(reader.Bytes(0), "");
  EXPECT_FALSE(reader.ok());
}

TEST(ByteReader, AStringCannotReachBeyondTheEnd) {
  ByteReader reader(
      std::string_view("\xff\xff\xff\xff"
                       "ab",
                       6));
  EXPECT_EQ(reader.String(), "");
  EXPECT_FALSE(reader.ok());
}

TEST(Crc32, HasTheCheckValueOfItsPolynomial) {
  EXPECT_EQ(Crc32::Of("123456789"), 0xcbf43926U);
  EXPECT_EQ(Crc32::Of(""), 0U);
}

TEST(Crc32, IsTheSameInPieces) {
  Crc32 crc;
  crc.Update("1234");
  crc.Update("");
  crc.Update("56789");
  EXPECT_EQ(crc.value(), 0xcbf43926U);
}

}  // namespace
}  // namespace shiftmap::mcap
