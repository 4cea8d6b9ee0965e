// SPDX-License-Identifier: Apache-2.0
//
// Stores and histories of landmarks.
#include <pybind11/stl.h>

#include <limits>
#include <mutex>

#include "mapstore/core/clock.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/map_store.h"
#include "tools/inspect/landmark_history.h"
#include "tools/python/python_values.h"

namespace shiftmap::python {
namespace {

using OptionalVersion = std::optional<std::int64_t>;

std::optional<VersionNumber> TakeVersion(const OptionalVersion& version) {
  if (!version) return std::nullopt;
  return VersionNumber(*version);
}

py::object NumberOrNone(const std::optional<VersionNumber>& version) {
  if (!version) return py::none();
  return py::int_(version->value());
}

// A store that Python's threads share: a MapStore is for one at a time.
class Store {
 public:
  explicit Store(const std::string& path)
      : store_(WithoutGil([&] { return MapStore::Open(path, MapStore::Access::kReadOnly); })) {}

  template <typename Work>
  auto Do(const Work& work) {
    return WithoutGil([&] {
      const std::lock_guard lock(mutex_);
      return work(&store_);
    });
  }

 private:
  std::mutex mutex_;
  MapStore store_;
};

MapSnapshot LoadMap(Store* store,
                    const std::string& area,
                    const OptionalVersion& version,
                    const std::optional<double>& at,
                    const std::optional<double>& known) {
  const auto at_stamp = TakeStamp(at);
  const auto known_stamp = TakeStamp(known);
  return store->Do([&](MapStore* maps) {
    const Stamp now = known_stamp.value_or(SystemNow());
    const Stamp when = at_stamp.value_or(now);
    return known_stamp ? maps->LoadKnown(area, now, TakeVersion(version), when)
                       : maps->LoadAt(area, TakeVersion(version), when);
  });
}

py::dict VisitColumns(const LandmarkHistory& history) {
  const std::vector<HistoryVisit>& visits = history.visits;
  py::dict columns;
  columns["begin_ns"] = Stamps(visits, [](const auto& visit) { return visit.begin; });
  columns["end_ns"] = Stamps(visits, [](const auto& visit) { return visit.end; });
  columns["vehicle"] = Texts(visits, [](const auto& visit) { return visit.vehicle; });
  columns["run"] = Texts(visits, [](const auto& visit) { return visit.run; });
  columns["run_name"] = Texts(visits, [](const auto& visit) { return visit.run_name; });
  columns["mapped"] = Array<bool>(visits, [](const auto& visit) { return visit.mapped; });
  columns["version"] =
      Array<std::int64_t>(visits, [](const auto& visit) { return visit.version.value(); });
  columns["observations"] =
      Array<std::int64_t>(visits, [](const auto& visit) { return visit.observations; });
  columns["likely_mode"] =
      Array<std::int64_t>(visits, [](const auto& visit) { return visit.likely_mode.value(); });
  columns["log_odds"] = Array<double>(visits, [](const auto& visit) { return visit.log_odds; });
  columns["set_aside"] = Texts(visits, [](const auto& visit) {
    return visit.set_aside ? std::string(Describe(*visit.set_aside)) : std::string();
  });
  return columns;
}

// A row per time, a column per mode, `absent` first; not a number where the store does not tell.
py::array_t<double> TrackArray(const LandmarkHistory& history) {
  const auto rows = static_cast<py::ssize_t>(history.track.size());
  const auto columns = static_cast<py::ssize_t>(history.probabilities.size());
  py::array_t<double> array({rows, columns});
  auto to = array.mutable_unchecked<2>();
  for (py::ssize_t row = 0; row < rows; ++row) {
    const auto& modes = history.track[static_cast<std::size_t>(row)].modes;
    for (py::ssize_t column = 0; column < columns; ++column) {
      const auto state = static_cast<std::size_t>(column);
      to(row, column) = state < modes.size() ? modes[state].probability
                                             : std::numeric_limits<double>::quiet_NaN();
    }
  }
  return array;
}

void BindHistory(py::module_* module) {
  py::class_<LandmarkHistory>(*module, "History", "Why a map says of a landmark what it says.")
      .def_property_readonly(
          "signature",
          [](const LandmarkHistory& history) { return Text(history.signature.text()); },
          "Of the landmark.")
      .def_property_readonly(
          "version",
          [](const LandmarkHistory& history) { return history.version.value(); },
          "Number of the map version.")
      .def_property_readonly(
          "stamp_ns",
          [](const LandmarkHistory& history) { return ToNanoseconds(history.stamp); },
          "Of the probabilities, nanoseconds since 1970.")
      .def_readonly("in_version",
                    &LandmarkHistory::in_version,
                    "The version has the landmark; if not, no visit counts.")
      .def_readonly(
          "move_rate_per_s", &LandmarkHistory::move_rate_per_s, "Moves in the long run. [1/s]")
      .def("__repr__",
           [](const LandmarkHistory& history) {
             return Text(fmt::format("<History signature='{}' version={} visits={}>",
                                     InertLine(history.signature.text()),
                                     history.version.value(),
                                     history.visits.size()));
           })
      .def_property_readonly(
          "modes",
          [](const LandmarkHistory& history) {
            return Array<std::int64_t>(history.probabilities,
                                       [](const auto& entry) { return entry.mode.value(); });
          },
          "Mode numbers, `absent` (0) first.")
      .def_property_readonly(
          "probabilities",
          [](const LandmarkHistory& history) {
            return Array<double>(history.probabilities,
                                 [](const auto& entry) { return entry.probability; });
          },
          "At `stamp_ns`, as `modes`.")
      .def_property_readonly(
          "positions",
          [](const LandmarkHistory& history) {
            return Matrices<2, 1>(history.modes,
                                  [](const auto& mode) { return mode.position.p_map_landmark; });
          },
          "Newest position of every mode that there ever was, as `all_modes`.")
      .def_property_readonly(
          "all_modes",
          [](const LandmarkHistory& history) {
            return Array<std::int64_t>(history.modes,
                                       [](const auto& mode) { return mode.number.value(); });
          },
          "Modes of all versions before this one too, without `absent`.")
      .def_property_readonly(
          "visits",
          &VisitColumns,
          "Columns with an entry per visit, oldest first: pandas.DataFrame(history.visits). "
          "`set_aside` says why a visit does not count; it is empty for one that does.")
      .def_property_readonly(
          "track", &TrackArray, "Probabilities at the times asked for, (times, modes).");
}

py::list Areas(Store* store) {
  py::list list;
  for (const AreaSummary& area : store->Do([](MapStore* maps) { return maps->Areas(); })) {
    py::dict entry;
    entry["area"] = Text(area.area);
    entry["published"] = NumberOrNone(area.published);
    entry["versions"] = area.versions;
    list.append(entry);
  }
  return list;
}

py::list Versions(Store* store, const std::string& area) {
  py::list list;
  const auto versions = store->Do([&](MapStore* maps) { return maps->Versions(area); });
  for (const VersionSummary& version : versions) {
    py::dict entry;
    entry["version"] = version.version.value();
    entry["parent"] = NumberOrNone(version.parent);
    entry["content_hash"] = version.content_hash;
    entry["published"] = version.published;
    entry["created_ns"] = ToNanoseconds(version.created);
    list.append(entry);
  }
  return list;
}

LandmarkHistory History(Store* store,
                        const std::string& area,
                        const std::string& signature,
                        const OptionalVersion& version,
                        const std::optional<double>& at,
                        const std::optional<double>& known,
                        const std::vector<double>& track) {
  HistoryOptions options;
  options.version = TakeVersion(version);
  options.at = TakeStamp(at);
  options.known = TakeStamp(known);
  for (const double seconds : track) options.track.push_back(TakeStamp(seconds));
  return store->Do([&](MapStore* maps) {
    return LoadLandmarkHistory(maps, area, Signature(signature), options);
  });
}

py::dict Trajectories(Store* store, const std::string& area, std::int64_t version) {
  const Provenance provenance =
      store->Do([&](MapStore* maps) { return maps->LoadProvenance(area, VersionNumber(version)); });
  py::dict runs;
  for (const RunRecord& run : provenance.runs) {
    runs[Text(run.name)] = py::make_tuple(
        Stamps(run.trajectory, [](const auto& pose) { return pose.stamp; }),
        Matrices<3, 1>(run.trajectory,
                       [](const auto& pose) { return PoseVector(pose.T_map_vehicle); }));
  }
  return runs;
}

}  // namespace

void BindStore(py::module_* module) {
  BindHistory(module);
  py::class_<Store>(*module,
                    "Store",
                    "A map store or a snapshot, read-only. Times are seconds since the epoch. "
                    "Threads may share one.")
      .def(py::init<const std::string&>(), py::arg("path"))
      .def("areas", &Areas, "Area, published version and number of versions of each.")
      .def("versions", &Versions, py::arg("area"), "All versions of an area, oldest first.")
      .def("load",
           &LoadMap,
           py::arg("area"),
           py::arg("version") = py::none(),
           py::arg("at") = py::none(),
           py::arg("known") = py::none(),
           "A version (the published one) with the probabilities at a time (now), as known at a "
           "time (now).")
      .def("history",
           &History,
           py::arg("area"),
           py::arg("signature"),
           py::arg("version") = py::none(),
           py::arg("at") = py::none(),
           py::arg("known") = py::none(),
           py::arg("track") = std::vector<double>(),
           "The history of a landmark; `track` gives times for its probabilities.")
      .def("trajectories",
           &Trajectories,
           py::arg("area"),
           py::arg("version"),
           "Of each run that the version was built from, (stamps_ns, poses (N, 3)), thinned.");
}

}  // namespace shiftmap::python
