// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/map_plot.h"

#include <fmt/format.h>

#include "mapstore/core/clock.h"
#include "mapstore/core/count_text.h"
#include "tools/plot/landmark_layer.h"
#include "tools/plot/run_layer.h"

namespace shiftmap {

std::string PlotMap(const MapSnapshot& map,
                    const std::vector<RunRecord>& runs,
                    const std::vector<RunRecord>& earlier) {
  const RunLayer run_layer(runs, earlier);
  const LandmarkLayer landmarks(map.content(), run_layer.Positions());
  Legend legend;
  landmarks.AddTo(&legend);
  run_layer.AddTo(&legend);
  Svg svg =
      StartMapPage({.title = fmt::format("{} · version {}", map.area(), map.version().value()),
                    .subtitle = fmt::format("probabilities at {} UTC · {}, {}",
                                            FormatUtc(map.stamp()),
                                            CountText(map.groups().size(), "landmark"),
                                            CountText(map.covariance().size(), "mode"))},
                   landmarks.frame(),
                   legend);
  run_layer.Draw(landmarks.frame(), &svg);
  landmarks.Draw(1.0, &svg);
  landmarks.DrawLabels(landmarks.MakePlacer(), &svg);
  return svg.ToString();
}

}  // namespace shiftmap
