// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/mine_drawing.h"

#include <gtest/gtest.h>
#include <png.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tools/sim/random.h"

namespace shiftmap {
namespace {

using testing::IsOk;
using testing::StatusIs;

constexpr MapWindow kEverything{-1e6, -1e6, 1e6, 1e6};

// Rows of `#` for dark and anything else for light.
GreyImage Image(const std::vector<std::string>& rows) {
  GreyImage image{static_cast<int>(rows[0].size()), static_cast<int>(rows.size()), {}};
  for (const std::string& row : rows) {
    for (const char c : row) image.pixels.push_back(c == '#' ? 0 : 255);
  }
  return image;
}

void WritePng(const GreyImage& image, const std::string& path) {
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  png.width = static_cast<png_uint_32>(image.columns);
  png.height = static_cast<png_uint_32>(image.rows);
  png.format = PNG_FORMAT_GRAY;
  ASSERT_NE(png_image_write_to_file(&png, path.c_str(), 0, image.pixels.data(), 0, nullptr), 0);
}

double SignedArea(const std::vector<Eigen::Vector2d>& closed) {
  double area = 0.0;
  for (const Wall& wall : WallsAlong(closed, true)) area += 0.5 * Cross(wall.a, wall.b);
  return area;
}

TEST(MineDrawing, BordersEncloseThePixelsAndRunBetweenDarkAndLight) {
  Random random = MakeRandom(1, 0);
  for (int i = 0; i < 30; ++i) {
    GreyImage image{17, 13, {}};
    const double density = Uniform(0.1, 0.9, &random);
    for (int k = 0; k < 17 * 13; ++k) image.pixels.push_back(Happens(density, &random) ? 0 : 255);
    int dark = 0;
    int changes = 0;
    for (int y = -1; y <= 13; ++y) {
      for (int x = -1; x <= 17; ++x) {
        dark += image.Dark(x, y);
        changes += image.Dark(x, y) != image.Dark(x + 1, y);
        changes += image.Dark(x, y) != image.Dark(x, y + 1);
      }
    }
    double area = 0.0;
    std::size_t length = 0;
    for (const std::vector<Eigen::Vector2d>& border : BordersOf(image)) {
      area += SignedArea(border);
      length += border.size();
      for (const Wall& step : WallsAlong(border, true)) EXPECT_EQ((step.b - step.a).norm(), 1.0);
    }
    EXPECT_NEAR(area, dark, 1e-9);
    EXPECT_EQ(length, static_cast<std::size_t>(changes));
  }
}

TEST(MineDrawing, PixelsThatTouchAtACornerHaveTheirOwnBorders) {
  EXPECT_EQ(BordersOf(Image({"#.", ".#"})).size(), 2U);
  EXPECT_EQ(BordersOf(Image({"###", "#.#", "###"})).size(), 2U) << "outside and inside";
}

TEST(MineDrawing, SimplifiedLinesStayWithinTheTolerance) {
  std::vector<Eigen::Vector2d> circle;
  for (int i = 0; i < 1000; ++i) {
    const double angle = i * 2.0 * 3.141592653589793 / 1000.0;
    circle.emplace_back(10.0 * std::cos(angle), 10.0 * std::sin(angle));
  }
  const std::vector<Eigen::Vector2d> corners = Simplified(circle, 0.1);
  EXPECT_LT(corners.size(), 40U);
  for (const Eigen::Vector2d& p : circle) {
    double least = 1e9;
    for (const Wall& wall : WallsAlong(corners, true)) {
      const Eigen::Vector2d along = wall.b - wall.a;
      const double share = std::clamp((p - wall.a).dot(along) / along.squaredNorm(), 0.0, 1.0);
      least = std::min(least, (p - wall.a - share * along).norm());
    }
    EXPECT_LE(least, 0.1 + 1e-9);
  }
  EXPECT_EQ(Simplified(BordersOf(Image({"####", "####"}))[0], 0.0).size(), 4U);
}

// Half a metre per pixel, x to the right, y up.
constexpr const char* kGeoreference = R"({"image": "walls.png", "site": {
    "x_m = x0 + xc*col + xr*row": [10.0, 0.5, 0.0],
    "y_m = y0 + yc*col + yr*row": [20.0, 0.0, -0.5]}})";

TEST(MineDrawing, WallsAreWhereTheGeoreferencePutsThem) {
  const testing::TempDir dir;
  WritePng(Image({"......", ".####.", ".####.", "......"}), dir.File("walls.png"));
  testing::WriteFile(dir.File("site.json"), kGeoreference);
  const auto walls = ReadMineDrawing(dir.File("site.json"), "site", kEverything, 0.01);
  ASSERT_THAT(walls, IsOk());
  ASSERT_EQ(walls->size(), 4U);
  Eigen::Vector2d low = (*walls)[0].a;
  Eigen::Vector2d high = low;
  for (const Wall& wall : *walls) {
    low = low.cwiseMin(wall.a);
    high = high.cwiseMax(wall.a);
  }
  // Columns 1 to 4 and rows 1 to 2, with half a pixel around their centres.
  EXPECT_EQ(low, Eigen::Vector2d(10.25, 18.75));
  EXPECT_EQ(high, Eigen::Vector2d(12.25, 19.75));
  const auto part =
      ReadMineDrawing(dir.File("site.json"), "site", {11.0, 19.0, 100.0, 100.0}, 0.01);
  ASSERT_THAT(part, IsOk());
  EXPECT_EQ(part->size(), 2U);
  for (const Wall& wall : *part) {
    EXPECT_GE(wall.a.cwiseMin(wall.b).x(), 11.0);
    EXPECT_GE(wall.a.cwiseMin(wall.b).y(), 19.0);
  }
}

TEST(MineDrawing, RefusesWhatIsNoDrawing) {
  const testing::TempDir dir;
  const auto read = [&](const char* frame = "site", const MapWindow& window = kEverything) {
    return ReadMineDrawing(dir.File("site.json"), frame, window, 0.1);
  };
  EXPECT_THAT(read(), StatusIs(StatusCode::kNotFound, "site.json"));
  testing::WriteFile(dir.File("site.json"), "[1]");
  EXPECT_THAT(read(), StatusIs(StatusCode::kInvalidArgument, "no JSON object"));
  testing::WriteFile(dir.File("site.json"), kGeoreference);
  EXPECT_THAT(read(), StatusIs(StatusCode::kNotFound, "walls.png"));
  testing::WriteFile(dir.File("walls.png"), "no picture");
  EXPECT_THAT(read(), StatusIs(StatusCode::kInvalidArgument, "no PNG file"));
  WritePng(Image({"###", "#.#", "###"}), dir.File("walls.png"));
  EXPECT_THAT(read("other"), StatusIs(StatusCode::kInvalidArgument, "no frame 'other'"));
  EXPECT_THAT(read("site", {0.0, 0.0, 1.0, 1.0}),
              StatusIs(StatusCode::kInvalidArgument, "no wall between"));
  EXPECT_THAT(read(), IsOk());
  const std::string whole = testing::ReadFile(dir.File("walls.png"));
  testing::WriteFile(dir.File("walls.png"), whole.substr(0, whole.size() / 2));
  EXPECT_THAT(read(), StatusIs(StatusCode::kInvalidArgument, "walls.png"));
}

TEST(MineDrawing, ReadsARealMine) {
  const char* data = std::getenv("SHIFTMAP_DATA");
  const std::filesystem::path path =
      std::filesystem::path(data == nullptr ? "data" : data) / "mine/mine_walls_georef.json";
  if (!std::filesystem::exists(path)) {
    GTEST_SKIP() << "no data at '" << path.string() << "'; set SHIFTMAP_DATA";
  }
  const auto walls = ReadMineDrawing(path.string(), "ex", {100.0, 75.0, 195.0, 280.0}, 0.15);
  ASSERT_THAT(walls, IsOk());
  EXPECT_GT(walls->size(), 1000U);
  EXPECT_LT(walls->size(), 10000U);
}

}  // namespace
}  // namespace shiftmap
