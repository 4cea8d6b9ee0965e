// SPDX-License-Identifier: Apache-2.0
//
// Run logs, and shifts replayed on a map.
#include <pybind11/eigen.h>
#include <pybind11/stl.h>

#include <array>

#include "localizer/initialization/start_pose.h"
#include "localizer/localizer.h"
#include "mapstore/codec/run_log.h"
#include "mapstore/core/inert_text.h"
#include "tools/python/python_values.h"

namespace shiftmap::python {
namespace {

// Of a pose that somebody gives without saying how sure it is. [m], [rad]
constexpr double kStartSdM = 0.5;
constexpr double kStartSdRad = 0.2;

// An observation with the time of its scan.
struct ObservationRow {
  Stamp stamp;
  const Observation* observation;
};

std::vector<ObservationRow> Rows(const Run& run) {
  std::vector<ObservationRow> rows;
  for (const Scan& scan : run.scans) {
    for (const Observation& observation : scan.observations) {
      rows.push_back({scan.stamp, &observation});
    }
  }
  return rows;
}

void BindRunLogInfo(py::class_<RunLog>* log_class) {
  (*log_class)
      .def_property_readonly(
          "vehicle",
          [](const RunLog& log) { return Text(log.run.info.vehicle); },
          "That made the log.")
      .def_property_readonly(
          "source",
          [](const RunLog& log) { return Text(log.run.info.source); },
          "Of the log, as its writer names it.")
      .def_property_readonly(
          "uuid",
          [](const RunLog& log) { return Text(log.run.info.uuid); },
          "Of the run; empty if the log has none.")
      .def_property_readonly(
          "area",
          [](const RunLog& log) { return Text(log.run.info.area); },
          "That the run is in; empty if the log does not say.")
      .def_property_readonly(
          "sha256", [](const RunLog& log) { return log.sha256; }, "Of the file, in hex.")
      .def("__repr__",
           [](const RunLog& log) {
             return Text(fmt::format("<RunLog vehicle='{}' scans={} observations={}>",
                                     InertLine(log.run.info.vehicle),
                                     log.run.scans.size(),
                                     Rows(log.run).size()));
           })
      .def_property_readonly(
          "truncation",
          [](const RunLog& log) { return Text(log.truncation); },
          "Where a log that ends early ends; empty if it does not.");
}

void BindRunLogArrays(py::class_<RunLog>* log_class) {
  (*log_class)
      .def_property_readonly(
          "odometry_ns",
          [](const RunLog& log) {
            return Stamps(log.run.odometry, [](const auto& sample) { return sample.stamp; });
          },
          "Stamps of odometry, nanoseconds since 1970.")
      .def_property_readonly(
          "odometry",
          [](const RunLog& log) {
            return Matrices<2, 1>(log.run.odometry, [](const auto& sample) {
              return Eigen::Vector2d(sample.v_mps, sample.omega_radps);
            });
          },
          "Speed and yaw rate, (N, 2), m/s and rad/s.")
      .def_property_readonly(
          "scans_ns",
          [](const RunLog& log) {
            return Stamps(log.run.scans, [](const auto& scan) { return scan.stamp; });
          },
          "Of all scans, also of those that saw nothing.")
      .def_property_readonly(
          "observations_ns",
          [](const RunLog& log) {
            return Stamps(Rows(log.run), [](const auto& row) { return row.stamp; });
          },
          "Stamps of observations, nanoseconds since 1970.")
      .def_property_readonly(
          "signatures",
          [](const RunLog& log) {
            return Texts(Rows(log.run),
                         [](const auto& row) { return row.observation->signature.text(); });
          },
          "Of each observation; empty for an anonymous landmark.")
      .def_property_readonly(
          "positions",
          [](const RunLog& log) {
            return Matrices<2, 1>(Rows(log.run), [](const auto& row) {
              return row.observation->PositionInVehicle();
            });
          },
          "Of each observation in the vehicle frame, (N, 2), metres.")
      .def_property_readonly(
          "lidar_ns",
          [](const RunLog& log) {
            return Stamps(log.run.lidar_scans, [](const auto& scan) { return scan.stamp; });
          },
          "Stamps of lidar scans, nanoseconds since 1970.")
      .def_property_readonly(
          "lidar_ranges",
          [](const RunLog& log) {
            py::list ranges;
            for (const LidarScan& scan : log.run.lidar_scans) {
              ranges.append(Array<float>(scan.ranges_m, [](float range) { return range; }));
            }
            return ranges;
          },
          "An array of ranges in metres per sweep of the lidar.");
}

// What a shift said, item by item.
struct Replay {
  std::vector<PoseEstimate> estimates;
  std::vector<LocalizerState> states;  // With each estimate.
  std::vector<StampedOutcome> innovations;
  std::optional<Localizer> localizer;  // At the end.
};

StatusOr<Replay> ReplayRun(const MapSnapshot& map,
                           const std::string& path,
                           const std::optional<std::string>& vehicle,
                           const LocalizerOptions& options) {
  const bool uses_lidar = options.hypotheses.field_of_view.model == FieldOfViewModel::kScanPolygon;
  SHIFTMAP_ASSIGN_OR_RETURN(const RunLog log, ReadRunLog(path, {.lidar_scans = uses_lidar}));
  Replay replay;
  Localizer& localizer =
      replay.localizer.emplace(map.ForVehicle(vehicle.value_or(log.run.info.vehicle)), options);
  const auto take = [&](const RunEvent& event) -> Status {
    SHIFTMAP_RETURN_IF_ERROR(localizer.Process(event));
    for (const PoseEstimate& estimate : localizer.new_estimates()) {
      replay.estimates.push_back(estimate);
      replay.states.push_back(localizer.state());
    }
    for (const StampedOutcome& outcome : localizer.new_innovations()) {
      if (outcome.outcome.gated) replay.innovations.push_back(outcome);
    }
    return OkStatus();
  };
  SHIFTMAP_RETURN_IF_ERROR(ForEachEvent(log.run, take));
  localizer.Finish();
  return replay;
}

const LandmarkGroup& GroupOf(const Replay& replay, const StampedOutcome& outcome) {
  return replay.localizer->snapshot().groups()[static_cast<std::size_t>(outcome.outcome.group)];
}

Replay ReplayLog(const MapSnapshot& map,
                 const std::string& log,
                 const std::optional<std::array<double, 3>>& initial_pose,
                 const std::optional<std::string>& vehicle,
                 double alpha,
                 int max_leaves,
                 bool scan_polygon) {
  LocalizerOptions options;
  options.hypotheses.alpha = alpha;
  options.hypotheses.max_leaves = max_leaves;
  if (scan_polygon) {
    options.hypotheses.field_of_view.model = FieldOfViewModel::kScanPolygon;
  }
  if (initial_pose) {
    const auto& [x, y, yaw] = *initial_pose;
    options.initial_pose = PoseWithCovariance{
        Se2(x, y, yaw),
        Eigen::Vector3d(kStartSdM, kStartSdM, kStartSdRad).cwiseAbs2().asDiagonal()};
    ThrowIfError(ValidateStart(*options.initial_pose));
  }
  ThrowIfError(options.Validate());
  return WithoutGil([&] { return ReplayRun(map, log, vehicle, options); });
}

py::dict Decisions(const Replay& replay) {
  const std::vector<Decision>& decisions = replay.localizer->decisions();
  py::dict columns;
  columns["stamp_ns"] = Stamps(decisions, [](const auto& decision) { return decision.stamp; });
  columns["signature"] =
      Texts(decisions, [](const auto& decision) { return decision.signature.text(); });
  columns["mode"] =
      Array<std::int64_t>(decisions, [](const auto& decision) { return decision.mode.value(); });
  columns["log_odds"] =
      Array<double>(decisions, [](const auto& decision) { return decision.log_odds; });
  return columns;
}

py::dict Innovations(const Replay& replay) {
  const std::vector<StampedOutcome>& all = replay.innovations;
  py::dict columns;
  columns["stamp_ns"] = Stamps(all, [](const auto& item) { return item.stamp; });
  columns["signature"] =
      Texts(all, [&](const auto& item) { return GroupOf(replay, item).signature.text(); });
  columns["mode"] = Array<std::int64_t>(all, [&](const auto& item) {
    return GroupOf(replay, item).NumberOf(item.outcome.state).value();
  });
  columns["nu"] = Matrices<2, 1>(all, [](const auto& item) { return item.outcome.nu; });
  columns["S"] = Matrices<2, 2>(all, [](const auto& item) { return item.outcome.S; });
  columns["nis"] = Array<double>(all, [](const auto& item) { return item.outcome.nis; });
  return columns;
}

py::dict StateChanges(const Replay& replay) {
  const auto& changes = replay.localizer->state_changes();
  py::dict columns;
  columns["stamp_ns"] = Stamps(changes, [](const auto& change) { return change.stamp; });
  columns["from"] = Texts(changes, [](const auto& change) { return ToString(change.from); });
  columns["to"] = Texts(changes, [](const auto& change) { return ToString(change.to); });
  columns["signature"] =
      Texts(changes, [](const auto& change) { return change.evidence.signature.text(); });
  return columns;
}

py::dict SecondsInState(const Replay& replay) {
  const LocalizerStatistics statistics = replay.localizer->Statistics();
  py::dict seconds;
  for (std::size_t i = 0; i < kLocalizerStates; ++i) {
    seconds[ToString(static_cast<LocalizerState>(i))] = statistics.seconds_in_state[i];
  }
  return seconds;
}

py::dict ModeProbabilities(const Replay& replay) {
  const std::vector<LandmarkGroup>& groups = replay.localizer->snapshot().groups();
  py::dict probabilities;
  for (std::size_t i = 0; i < groups.size(); ++i) {
    probabilities[Text(groups[i].signature.text())] =
        replay.localizer->Probabilities(static_cast<int>(i));
  }
  return probabilities;
}

void BindReplayArrays(py::class_<Replay>* replay_class) {
  (*replay_class)
      .def_property_readonly(
          "localized",
          [](const Replay& replay) { return replay.localizer->Statistics().localized(); },
          "False if the log fits no place of the map.")
      .def_property_readonly(
          "stamps_ns",
          [](const Replay& replay) {
            return Stamps(replay.estimates, [](const auto& estimate) { return estimate.stamp; });
          },
          "Of poses, nanoseconds since 1970.")
      .def_property_readonly(
          "poses",
          [](const Replay& replay) {
            return Matrices<3, 1>(replay.estimates, [](const auto& estimate) {
              return PoseVector(estimate.pose.T_map_vehicle);
            });
          },
          "x, y, yaw after each scan, (N, 3), metres and radians.")
      .def_property_readonly(
          "covariances",
          [](const Replay& replay) {
            return Matrices<3, 3>(replay.estimates, [](const auto& estimate) {
              return estimate.pose.cov_T_map_vehicle;
            });
          },
          "Of T * Exp(xi), order (x, y, yaw) in the vehicle frame, (N, 3, 3).")
      .def_property_readonly(
          "quality",
          [](const Replay& replay) {
            return Array<double>(replay.estimates,
                                 [](const auto& estimate) { return estimate.quality; });
          },
          "Probability of innovations as large as the last ones, with each pose.")
      .def_property_readonly(
          "states",
          [](const Replay& replay) {
            return Texts(replay.states, [](LocalizerState state) { return ToString(state); });
          },
          "With each pose.");
}

void BindReplayColumns(py::class_<Replay>* replay_class) {
  (*replay_class)
      .def_property_readonly("state_changes", &StateChanges, "Columns of all changes of state.")
      .def_property_readonly(
          "seconds_in_state", &SecondsInState, "By state, the time spent in it. [s]")
      .def_property_readonly("decisions", &Decisions, "Columns of the decisions that stand.")
      .def_property_readonly(
          "innovations",
          &Innovations,
          "Columns of the observations that gated with a mode: nu (N, 2) in the vehicle frame, S "
          "(N, 2, 2), and nis, chi-square with 2 degrees of freedom if the model holds.")
      .def_property_readonly("mode_probabilities",
                             &ModeProbabilities,
                             "By signature, at the end: `absent`, then each mode.");
}

}  // namespace

void BindRuns(py::module_* module) {
  py::class_<RunLog> log_class(
      *module, "RunLog", "A vehicle's log. Every access makes new arrays.");
  BindRunLogInfo(&log_class);
  BindRunLogArrays(&log_class);
  py::class_<Replay> replay_class(*module, "Replay", "What a localizer said on a map about a log.");
  replay_class.def("__repr__", [](const Replay& replay) {
    return fmt::format(
        "<Replay poses={} innovations={}>", replay.estimates.size(), replay.innovations.size());
  });
  BindReplayArrays(&replay_class);
  BindReplayColumns(&replay_class);
  module->def("replay",
              &ReplayLog,
              py::arg("map"),
              py::arg("log"),
              py::arg("initial_pose") = py::none(),
              py::arg("vehicle") = py::none(),
              py::arg("alpha") = HypothesisOptions().alpha,
              py::arg("max_leaves") = HypothesisOptions().max_leaves,
              py::arg("scan_polygon") = false,
              "Localizes a run log on a map. `initial_pose` is x, y, yaw, or None: found from what "
              "is seen; `vehicle` names the vehicle whose calibration counts, None: as the log "
              "does.");
  module->def(
      "read_run_log",
      [](const std::string& path) { return WithoutGil([&] { return ReadRunLog(path); }); },
      py::arg("path"),
      "Reads a run log (MCAP) whole.");
}

}  // namespace shiftmap::python
