// SPDX-License-Identifier: Apache-2.0
//
// Maps.
#include <pybind11/eigen.h>

#include "mapstore/core/inert_text.h"
#include "mapstore/map/map_snapshot.h"
#include "tools/python/python_values.h"

namespace shiftmap::python {
namespace {

using MapClass = py::class_<MapSnapshot>;

// A mode with its group and its state in it.
struct ModeRow {
  const LandmarkGroup* group;
  const Mode* mode;
  double probability;
};

std::vector<ModeRow> Rows(const MapSnapshot& map) {
  std::vector<ModeRow> rows;
  for (const LandmarkGroup& group : map.groups()) {
    for (std::size_t i = 0; i < group.modes.size(); ++i) {
      rows.push_back(
          {&group, &group.modes[i], group.probabilities(static_cast<Eigen::Index>(i + 1))});
    }
  }
  return rows;
}

const LandmarkGroup& GroupNamed(const MapSnapshot& map, const std::string& signature) {
  const int index = map.GroupIndex(Signature(signature));
  if (index < 0) {
    throw StatusError(NotFound("area '{}': version {} has no landmark '{}'",
                               map.area(),
                               map.version().value(),
                               signature));
  }
  return map.groups()[static_cast<std::size_t>(index)];
}

void BindIdentity(MapClass* map_class) {
  (*map_class)
      .def_property_readonly(
          "area", [](const MapSnapshot& map) { return Text(map.area()); }, "Name of the area.")
      .def_property_readonly(
          "version",
          [](const MapSnapshot& map) { return map.version().value(); },
          "Number of the version.")
      .def_property_readonly(
          "content_hash",
          [](const MapSnapshot& map) { return map.content_hash(); },
          "SHA-256 of the content, in hex.")
      .def_property_readonly(
          "stamp_ns",
          [](const MapSnapshot& map) { return ToNanoseconds(map.stamp()); },
          "When the probabilities hold.")
      .def("__len__", [](const MapSnapshot& map) { return map.covariance().size(); })
      .def("__repr__", [](const MapSnapshot& map) {
        return Text(fmt::format("<Map area='{}' version={} landmarks={} modes={}>",
                                InertLine(map.area()),
                                map.version().value(),
                                map.groups().size(),
                                map.covariance().size()));
      });
}

// A row per landmark.
void BindLandmarks(MapClass* map_class) {
  (*map_class)
      .def_property_readonly(
          "landmarks",
          [](const MapSnapshot& map) {
            return Texts(map.groups(), [](const auto& group) { return group.signature.text(); });
          },
          "Each signature once.")
      .def_property_readonly(
          "absent",
          [](const MapSnapshot& map) {
            return Array<double>(map.groups(),
                                 [](const auto& group) { return group.probabilities(0); });
          },
          "Probability that a landmark is at none of its modes, as `landmarks`.")
      .def_property_readonly(
          "leave_rates_per_s",
          [](const MapSnapshot& map) {
            return Array<double>(map.groups(),
                                 [](const auto& group) { return group.chain.leave_rate_per_s(); });
          },
          "Rate of leaving a mode, as `landmarks`.")
      .def_property_readonly(
          "anonymous_positions",
          [](const MapSnapshot& map) {
            return Matrices<2, 1>(map.anonymous_landmarks(),
                                  [](const Mode& mode) { return mode.p_map_landmark; });
          },
          "Of landmarks without a signature, (M, 2).");
}

// A row per mode.
void BindModes(MapClass* map_class) {
  (*map_class)
      .def_property_readonly(
          "signatures",
          [](const MapSnapshot& map) {
            return Texts(Rows(map), [](const ModeRow& row) { return row.group->signature.text(); });
          },
          "Of each mode, the signature of its landmark.")
      .def_property_readonly(
          "modes",
          [](const MapSnapshot& map) {
            return Array<std::int64_t>(Rows(map),
                                       [](const ModeRow& row) { return row.mode->number.value(); });
          },
          "Numbers, of each mode.")
      .def_property_readonly(
          "positions",
          [](const MapSnapshot& map) {
            return Matrices<2, 1>(Rows(map),
                                  [](const ModeRow& row) { return row.mode->p_map_landmark; });
          },
          "(N, 2)")
      .def_property_readonly(
          "covariances",
          [](const MapSnapshot& map) {
            return Matrices<2, 2>(Rows(map),
                                  [](const ModeRow& row) { return row.mode->cov_p_map_landmark; });
          },
          "Marginal, (N, 2, 2), order (x, y), square metres.")
      .def_property_readonly(
          "probabilities",
          [](const MapSnapshot& map) {
            return Array<double>(Rows(map), [](const ModeRow& row) { return row.probability; });
          },
          "That it holds, of each mode.")
      .def_property_readonly(
          "last_seen_ns",
          [](const MapSnapshot& map) {
            return Stamps(Rows(map), [](const ModeRow& row) { return row.mode->last_seen; });
          },
          "Newest observation that built a mode; 0 for a surveyed one.");
}

void BindMatrices(MapClass* map_class) {
  (*map_class)
      .def(
          "joint_covariance",
          [](const MapSnapshot& map) { return map.covariance().Dense(); },
          "Of all positions, (2 N, 2 N), in the order of `positions`.")
      .def(
          "rate_matrix",
          [](const MapSnapshot& map, const std::string& signature) {
            return GroupNamed(map, signature).chain.rate_matrix();
          },
          py::arg("signature"),
          "Rates of a landmark's chain, row = from, column = to, `absent` first.")
      .def(
          "transition",
          [](const MapSnapshot& map, const std::string& signature, double elapsed_s) {
            if (!(elapsed_s >= 0.0 && elapsed_s <= 9.2e9)) {
              throw StatusError(InvalidArgument("elapsed_s: {}, expected 0 to 9.2e9", elapsed_s));
            }
            return GroupNamed(map, signature).chain.Transition(FromSeconds(elapsed_s));
          },
          py::arg("signature"),
          py::arg("elapsed_s"),
          "Probability of each state after a time, row = from, column = to, `absent` first.");
}

}  // namespace

void BindMap(py::module_* module) {
  MapClass map_class(
      *module,
      "Map",
      "A map version at a time. Arrays have a row per mode, landmarks by signature, modes by "
      "number; every access makes new ones. Metres in the map frame.");
  BindIdentity(&map_class);
  BindLandmarks(&map_class);
  BindModes(&map_class);
  BindMatrices(&map_class);
}

}  // namespace shiftmap::python
