// SPDX-License-Identifier: Apache-2.0
//
// Reads the input as the files of a public data set, or as tables, one after the other and
// separated by \xff. The first byte chooses. A run that is accepted is in order.
#include <algorithm>

#include "proto/core/check.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/temp_dir.h"
#include "tools/convert/csv_run.h"
#include "tools/convert/utias.h"
#include "tools/convert/victoria_park.h"

namespace shiftmap::testing {
namespace {

constexpr char kNextFile = '\xff';

void WriteFiles(std::string_view bytes,
                const std::string& folder,
                const std::vector<std::string>& names) {
  for (const std::string& name : names) {
    const std::size_t end = bytes.find(kNextFile);
    WriteFile(folder + "/" + name, std::string(bytes.substr(0, end)));
    bytes.remove_prefix(end == std::string_view::npos ? bytes.size() : end + 1);
  }
}

// Numbers beyond a log's limits are refused where it is written.
void CheckRun(const Run& run) {
  const auto earlier = [](const auto& a, const auto& b) { return a.stamp < b.stamp; };
  SHIFTMAP_CHECK(std::is_sorted(run.odometry.begin(), run.odometry.end(), earlier) &&
                     std::is_sorted(run.scans.begin(), run.scans.end(), earlier),
                 "items out of order");
}

void ReadAsUtias(std::string_view bytes, const std::string& folder) {
  WriteFiles(bytes,
             folder,
             {"Barcodes.dat",
              "Robot1_Odometry.dat",
              "Robot1_Measurement.dat",
              "Landmark_Groundtruth.dat",
              "Robot1_Groundtruth.dat"});
  UtiasOptions options;
  options.dataset_dir = folder;
  if (const auto run = ReadUtias(options); run.ok()) CheckRun(run->run);
  options.start_s = 1.0;
  options.duration_s = 2.0;
  if (const auto run = ReadUtias(options); run.ok()) CheckRun(run->run);
  ReadUtiasLandmarks(folder).status().IgnoreError();
  ReadUtiasGroundtruth(folder, 1).status().IgnoreError();
}

void ReadAsVictoriaPark(std::string_view bytes, const std::string& folder) {
  WriteFiles(bytes, folder, {"controls.csv", "tree_detections.csv", "gps.csv"});
  VictoriaParkOptions options;
  options.dataset_dir = folder;
  if (const auto run = ReadVictoriaPark(options); run.ok()) CheckRun(run->run);
  ReadVictoriaParkGps(folder).status().IgnoreError();
}

void ReadAsTables(std::string_view bytes, const std::string& folder) {
  WriteFiles(bytes, folder, {"odometry.csv", "observations.csv", "truth.csv"});
  CsvRunOptions options;
  options.odometry = folder + "/odometry.csv";
  options.observations = folder + "/observations.csv";
  options.truth = folder + "/truth.csv";
  if (const auto csv = ReadCsvRun(options); csv.ok()) CheckRun(csv->run);
}

}  // namespace

std::vector<std::string> FuzzSeeds() {
  const std::string next(1, kNextFile);
  return {"",
          "\1# subject barcode\n1 5\n6 72\n7 27\n" + next +
              "1.0 0.5 0.1\n2.0 0.5 0.1\n3.5 1e9 -1e9\n" + next +
              "1.5 72 2.0 0.3\n1.5 5 2.0 0.3\n2.5 27 1e9 3.1\n2.5 99 1 1\n" + next +
              "6 1.0 2.0 0.01 0.01\n7 -1 1e300 0 0\n" + next + "1.0 0 0 0\n2.0 1 1 6.3\n",
          "\1"
          "6 72\n" +
              next + "7000000000.000000000 0 0\n" + next + "7e9 72 1 1\n" + next + next,
          "\1"
          "6 9223372036854775807\n" +
              next + "-1 5e-324 0\n0.000000001 1e9 1e9\n" + next +
              "0 9223372036854775807 5e-324 1e9\n" + next + next,
          std::string(1, '\0') + "t_s,speed_mps,steering_rad\n1.0,2.5,0.1\n2.0,2.5,-0.1\n" + next +
              "scan,t_s,range_m,bearing_raw\n0,1.5,10,1.0\n0,1.5,12,2.0\n1,1.7,10,1.1\n" + next +
              "t_s,x_m,y_m\n1.0,5,6\n",
          "\2stamp_s,v_mps,omega_radps\n1,1e9,0\n2.5,0,-1e-300\n" + next +
              "stamp_s,signature,range_m,bearing_rad,sd_range_m,sd_bearing_rad\n"
              "1,\"a\"\"b\",2,0.5,1,1e-30\n1,,,,,\n2,'=c,5e-324,7,,\n" +
              next + "yaw_rad,stamp_s,x_m,y_m\n7,1,1e300,0\n",
          "\2stamp_s,v_mps,omega_radps\n7e9,1,1\n7000000000,1,1\n" + next +
              "signature,x_m,stamp_s,y_m\n,0,1,0\n" + next + "stamp_s,x_m,y_m,yaw_rad\n",
          std::string(1, '\0') +
              "t_s,speed_mps,steering_rad\n0,1e9,1.5707963267948966\n7e9,-1e9,1e9\n" + next +
              "scan,t_s,range_m,bearing_raw\n0,0,1e-300,0\n9223372036854775807,7e9,1e9,1e9\n" +
              next + "t_s,x_m,y_m\n0,1e308,-1e308\n"};
}

void RunFuzzInput(std::string_view bytes) {
  static const TempDir folder;
  if (bytes.empty()) return;
  const auto kind = static_cast<unsigned char>(bytes.front()) % 3;
  if (kind == 2) {
    ReadAsTables(bytes.substr(1), folder.path());
  } else if (kind == 1) {
    ReadAsUtias(bytes.substr(1), folder.path());
  } else {
    ReadAsVictoriaPark(bytes.substr(1), folder.path());
  }
}

}  // namespace shiftmap::testing
