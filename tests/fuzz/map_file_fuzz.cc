// SPDX-License-Identifier: Apache-2.0
//
// Reads the input, without its first byte, as a map in the format that the byte picks. One that is
// accepted is a valid map, and comes back from its message with an equal hash.
#include "mapper/cli/map_file.h"

#include "mapstore/codec/map_message.h"
#include "proto/core/check.h"
#include "tests/fuzz/fuzz_file.h"
#include "tests/fuzz/fuzz_target.h"

namespace shiftmap::testing {

std::vector<std::string> FuzzSeeds() {
  const std::string group =
      "group { signature: 'L1' mode { mode: 1 x_m: 1 cov_xx_m2: 1 cov_xy_m2: 0.1 cov_yy_m2: 2 } "
      "mode { mode: 3 cov_xx_m2: 1 cov_yy_m2: 1 } probability: [0.1, 0.4, 0.5] ";
  const std::string feature =
      R"({"type": "Feature", "geometry": {"type": "Point", "coordinates": [1, 2]}, "properties": )";
  const std::string collection =
      R"({"type": "FeatureCollection", "coordinates": "metres in the map frame", "stamp_s": 1e9, )"
      R"("features": [)";
  return {
      "2" + group + "leave_rate_per_s: 1e-5 retired { mode: 2 into: 1 } } stamp_ns: 1",
      "2" + group +
          "rate_per_s: [-3, 1, 2, 0, 0, 0, 1, 1, -2] } "
          "cross_covariance { row: 0 column: 1 cov_m2: [1, 2, 3, 4] }",
      "2vehicle { vehicle: 'v' runs: 1 values { lag_sd_s: 1 } } calibration { }",
      R"(3{"group": [{"signature": "L1", "mode": [{"mode": "1", "cov_xx_m2": 1, "cov_yy_m2": 1}],)"
      R"( "probability": [0.5, 0.5]}]})",
      "1" + collection + feature +
          R"({"signature": "L1", "mode": 1, "probability": 0.5, "cov_m2": [1, 0, 1]}}, )" +
          feature + R"({"cov_m2": [1, 0, 1], "last_seen_s": 1e9}}]})",
      "0signature,mode,x_m,y_m,sd_x_m,sd_y_m,probability\nL01,1,1,2,0.1,0.1,0.5\n",
      "1[[[[[[[[[[[[",
      "3{\"group\":[{\"mode\":[{\"mode\":{}"};
}

void RunFuzzInput(std::string_view bytes) {
  if (bytes.empty()) return;
  const std::vector<std::string>& formats = MapFileFormats();
  MapFileOptions options;
  options.format = formats[1 + static_cast<unsigned char>(bytes.front()) % (formats.size() - 1)];
  const auto content = ReadMapFile(FuzzFile(bytes.substr(1)), options);
  if (!content.ok()) return;
  const Status valid = ValidateMapContent(*content);
  SHIFTMAP_CHECK(valid.ok(), "an invalid map was read: {}", Message(valid));
  const MapSnapshot map("area", VersionNumber(1), ContentHash(*content), *content);
  const auto text = EncodeMap(map, MapForm::kBinary);
  if (!text.ok()) return;
  const auto again = DecodeMap(*text, MapForm::kBinary);
  SHIFTMAP_CHECK(again.ok(), "{}", Message(again.status()));
  SHIFTMAP_CHECK(ContentHash(again->content()) == map.content_hash(), "another map");
}

}  // namespace shiftmap::testing
