// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/rosbag2/message_definition.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"
#include "tools/convert/rosbag2/builtin_definitions.h"

namespace shiftmap::rosbag2 {
namespace {

using shiftmap::testing::IsOk;
using shiftmap::testing::StatusIs;
using Count = MessageField::Count;
using Kind = MessageField::Kind;

void ExpectRefused(const std::string& text, const std::string& part) {
  EXPECT_THAT(MessageDefinition::Parse("pkg/msg/A", text).status(),
              StatusIs(StatusCode::kInvalidArgument, part))
      << text.substr(0, 200);
}

TEST(MessageDefinition, ReadsFieldsAndDropsAllElse) {
  const auto definition = MessageDefinition::Parse("pkg/msg/A",
                                                   "# A comment.\r\n"
                                                   "uint8 LOW=0\n"
                                                   "string NAME = \"a # b\"\n"
                                                   "float64 x 1.5   # with a default\n"
                                                   "int32[] counts [1, 2]\n"
                                                   "string<=10 name\n"
                                                   "B[<=5] parts\n"
                                                   "\tother/C[3] others\n"
                                                   "Header header\n"
                                                   "time when\n"
                                                   "=====\n"
                                                   "MSG: pkg/B\n"
                                                   "byte b\n"
                                                   "================\n"
                                                   "MSG: other/msg/C\n"
                                                   "===\n"
                                                   "MSG: std_msgs/Header\n"
                                                   "builtin_interfaces/Time stamp\n");
  ASSERT_THAT(definition.status(), IsOk());
  const auto& fields = definition->root().fields;
  ASSERT_EQ(fields.size(), 7U);
  const auto expect = [&](std::size_t i, const char* name, Kind kind, Count count) {
    EXPECT_EQ(fields[i].name, name);
    EXPECT_EQ(fields[i].kind, kind) << name;
    EXPECT_EQ(fields[i].count, count) << name;
  };
  expect(0, "x", Kind::kFloat64, Count::kOne);
  expect(1, "counts", Kind::kInt32, Count::kSequence);
  expect(2, "name", Kind::kString, Count::kOne);
  expect(3, "parts", Kind::kMessage, Count::kSequence);
  expect(4, "others", Kind::kMessage, Count::kFixed);
  expect(5, "header", Kind::kMessage, Count::kOne);
  expect(6, "when", Kind::kMessage, Count::kOne);
  EXPECT_EQ(fields[4].fixed_count, 3U);
  EXPECT_EQ(definition->types()[fields[3].message].name, "pkg/B");
  EXPECT_EQ(definition->types()[fields[4].message].name, "other/C");
  EXPECT_EQ(definition->types()[fields[6].message].fields.size(), 2U);
}

TEST(MessageDefinition, RefusesWhatHasNoSize) {
  ExpectRefused("A again\n", "type 'pkg/A' contains itself");
  ExpectRefused("B b\n===\nMSG: pkg/B\nC[] c\n===\nMSG: pkg/C\nB[] b\n", "contains itself");
  ExpectRefused("B b\n", "type 'pkg/B' is not defined");
  ExpectRefused("uint8[0] none\n", "array of '0'");
  ExpectRefused("uint8[99999999999999999999] many\n", "array of");
  ExpectRefused("wstring text\n", "wstring is not supported");
}

TEST(MessageDefinition, RefusesWhatIsNoDefinition) {
  ExpectRefused("hello\n", "expected a type and a name");
  ExpectRefused("float64 a-b\n", "expected a type and a name");
  ExpectRefused("float64] a\n", "type 'float64]'");
  ExpectRefused("float64 a\n===\nfloat64 b\n", "expected 'MSG: package/Type'");
  ExpectRefused(std::string("float64 \0\n", 10), "expected a type and a name");
}

TEST(MessageDefinition, RefusesWhatIsTooLarge) {
  ExpectRefused(std::string((1 << 20) + 1, '#'), "bytes, expected at most");
  std::string fields;
  for (int i = 0; i < 20'001; ++i) fields += "bool a\n";
  ExpectRefused(fields, "more than 20000 fields");
  std::string types;
  for (int i = 0; i < 1001; ++i) types += "===\nMSG: p/T" + std::to_string(i) + "\n";
  ExpectRefused(types, "more than 1000 types");
  std::string chain = "T0 a\n";
  for (int i = 0; i < 40; ++i) chain += fmt::format("===\nMSG: pkg/T{}\nT{} a\n", i, i + 1);
  ExpectRefused(chain + "===\nMSG: pkg/T40\n", "nested more than 32 deep");
}

TEST(BuiltinDefinitions, AreWhole) {
  for (const char* type : {"nav_msgs/msg/Odometry",
                           "geometry_msgs/msg/TwistStamped",
                           "tf2_msgs/msg/TFMessage",
                           "vision_msgs/msg/Detection3DArray",
                           "fiducial_msgs/msg/FiducialTransformArray",
                           "apriltag_msgs/msg/AprilTagDetectionArray"}) {
    EXPECT_THAT(MessageDefinition::Parse(type, BuiltinDefinition(type)).status(), IsOk()) << type;
  }
  EXPECT_EQ(BuiltinDefinition("sensor_msgs/msg/Image"), "");
}

}  // namespace
}  // namespace shiftmap::rosbag2
