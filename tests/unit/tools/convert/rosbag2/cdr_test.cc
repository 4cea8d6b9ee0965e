// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/rosbag2/cdr.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"
#include "tests/unit/tools/convert/rosbag2/bag_test_util.h"
#include "tools/convert/rosbag2/builtin_definitions.h"

namespace shiftmap::rosbag2 {
namespace {

using shiftmap::testing::IsOk;
using shiftmap::testing::StatusIs;

MessageDefinition Parsed(const std::string& type, const std::string& text) {
  return MessageDefinition::Parse(type, text).value();
}

MessageDefinition Builtin(const std::string& type) { return Parsed(type, BuiltinDefinition(type)); }

const std::string kLittle("\0\1\0\0", 4);

TEST(Cdr, ReadsBothByteOrders) {
  const MessageDefinition definition = Builtin("geometry_msgs/TwistStamped");
  for (const auto order : {testing::ByteOrder::kLittle, testing::ByteOrder::kBig}) {
    const std::string bytes = testing::Twist(1'500'000'001'000'000'002, 1.25, -0.5, order);
    const auto value = DecodeCdr(definition, bytes);
    ASSERT_THAT(value.status(), IsOk());
    EXPECT_EQ(value->Number("twist.linear.x").value(), 1.25);
    EXPECT_EQ(value->Number("twist.angular.z").value(), -0.5);
    EXPECT_EQ(value->Text("header.frame_id").value(), "base_link");
    EXPECT_EQ(ToNanoseconds(value->Time("header.stamp").value()), 1'500'000'001'000'000'002);
  }
}

TEST(Cdr, FieldsThatOthersAddedAreReadAround) {
  // As nav_msgs/Odometry with a picture before and a list of names in the middle.
  const MessageDefinition definition =
      Parsed("p/A", "uint8[] picture\nfloat64 x\nstring[2] names\nbool[3] flags\nint16 y\n");
  std::string bytes = kLittle;
  bytes += std::string("\3\0\0\0abc", 7) + std::string(1, '\0');   // Aligned to 8.
  bytes += std::string("\0\0\0\0\0\0\xf8\x3f", 8);                 // 1.5
  bytes += std::string("\2\0\0\0a\0\0\0\3\0\0\0bc\0", 15);         // Two names.
  bytes += std::string("\1\0\1", 3) + std::string("\xfe\xff", 2);  // Flags, -2.
  const auto value = DecodeCdr(definition, bytes);
  ASSERT_THAT(value.status(), IsOk());
  EXPECT_EQ(value->Text("picture").value(), "abc");
  EXPECT_EQ(value->Number("x").value(), 1.5);
  EXPECT_EQ((*value->List("names").value())[1].Text("").value(), "bc");
  EXPECT_EQ(value->Integer("y").value(), -2);
  EXPECT_THAT(value->Number("names").status(), StatusIs(StatusCode::kInvalidArgument, "'names'"));
  EXPECT_THAT(value->Text("x.y.z").status(), StatusIs(StatusCode::kInvalidArgument, "'x.y.z'"));
}

TEST(Cdr, RefusesEveryMessageThatIsCutOff) {
  const MessageDefinition definition = Builtin("vision_msgs/Detection3DArray");
  const std::string bytes =
      testing::Detections(1, {{"L1", Eigen::Vector3d::Ones(), 0.1}, {"L2", {}, 0.0}});
  ASSERT_THAT(DecodeCdr(definition, bytes).status(), IsOk());
  for (std::size_t length = 0; length < bytes.size(); ++length) {
    EXPECT_THAT(DecodeCdr(definition, bytes.substr(0, length)).status(),
                StatusIs(StatusCode::kInvalidArgument, "vision_msgs/Detection3DArray"))
        << length;
  }
  EXPECT_THAT(DecodeCdr(definition, bytes + std::string(9, '\0')).status(),
              StatusIs(StatusCode::kInvalidArgument, "9 bytes behind the message"));
}

TEST(Cdr, BelievesNoCountBeforeItsElementsAreThere) {
  const std::string many = kLittle + "\xff\xff\xff\x7f";
  for (const char* field : {"float64[] a", "string[] a", "uint8[] a", "B[] a", "string a"}) {
    const auto definition = Parsed("p/A", std::string(field) + "\n===\nMSG: p/B\n");
    EXPECT_THAT(DecodeCdr(definition, many).status(),
                StatusIs(StatusCode::kInvalidArgument, "ends inside a field"))
        << field;
  }
}

TEST(Cdr, ATypeOfExponentialSizeEndsWithTheBytes) {
  std::string text = "T0 a\n";
  for (int i = 0; i < 30; ++i) {
    text += fmt::format("===\nMSG: p/T{}\nT{}[1000] a\n", i, i + 1);
  }
  text += "===\nMSG: p/T30\n";
  const auto definition = Parsed("p/A", text);
  EXPECT_THAT(DecodeCdr(definition, kLittle + std::string(2000, 'x')).status(),
              StatusIs(StatusCode::kInvalidArgument, "ends inside a field"));
}

TEST(Cdr, RefusesOtherEncodings) {
  const MessageDefinition definition = Builtin("geometry_msgs/TwistStamped");
  std::string bytes = testing::Twist(1, 1.0, 1.0);
  for (const char kind : {'\2', '\3', '\7', '\x0b'}) {
    bytes[1] = kind;
    EXPECT_THAT(DecodeCdr(definition, bytes).status(),
                StatusIs(StatusCode::kInvalidArgument, "this build reads plain CDR"));
  }
  EXPECT_THAT(DecodeCdr(definition, std::string((16 << 20) + 1, '\0')).status(),
              StatusIs(StatusCode::kInvalidArgument, "expected at most"));
}

}  // namespace
}  // namespace shiftmap::rosbag2
