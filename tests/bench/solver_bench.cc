// SPDX-License-Identifier: Apache-2.0
//
// The graph's own solver beside Ceres, Eigen and CHOLMOD: a recorded run of 340 s (SHIFTMAP_DATA),
// and simulated runs of 1,300 key frames on a floor: 1, 7 and 30 of them, and 77 with
// SHIFTMAP_BENCH_LARGE=1.
// The first argument is the number of runs, 0 for the recorded one. Counters: `key_frames`,
// `peak_mib` above what the process had before, `cost`, and `off_mm`, the largest distance of a
// mode from where the own solver has it after it went on to 1e-9.
#include <benchmark/benchmark.h>
#include <ceres/solver.h>
#include <fmt/format.h>
#include <Eigen/CholmodSupport>
#include <Eigen/SparseCholesky>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "mapper/covariance/mode_covariance.h"
#include "mapper/frontend/mapping_run.h"
#include "mapper/graph/ceres_problem.h"
#include "mapper/graph/graph.h"
#include "mapper/graph/schur_posterior.h"
#include "mapper/mapper.h"
#include "mapper/run_maps/single_run.h"
#include "tools/convert/utias.h"

namespace shiftmap {
namespace {

constexpr int kFrames = 1300;    // Of a simulated run.
constexpr double kGridM = 4.0;   // From mode to mode.
constexpr double kStepM = 0.4;   // From key frame to key frame.
constexpr double kRangeM = 5.0;  // Of the sensor.
constexpr double kDisturbed = 0.02;

// The resident memory of this process: what it has, or the most since ResetPeak(). [MiB]
double ResidentMib(const std::string& name) {
  std::ifstream status("/proc/self/status");
  std::string word;
  double kib = 0.0;
  while (status >> word) {
    if (word == name) status >> kib;
  }
  return kib / 1024.0;
}

double ResetPeak() {
  std::ofstream("/proc/self/clear_refs") << "5";
  return ResidentMib("VmRSS:");
}

// The motion that the truth makes, with noise, and how well it is known.
MotionIncrement NoisyMotion(const Se2& T_begin_end, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  MotionIncrement motion;
  motion.T_begin_end =
      T_begin_end *
      Se2::Exp({0.01 * normal(random), 0.01 * normal(random), 0.003 * normal(random)});
  motion.cov = Eigen::Vector3d(1e-4, 1e-4, 1e-5).asDiagonal();
  motion.J_calibration << kStepM, 0.0, 0.01, 0.0, 0.0, 0.002, 0.0, 0.06, 0.001;
  return motion;
}

// Vehicles that turn at random and back at the edge of a floor, among modes on a grid.
Graph MakeFloor(int runs) {
  std::mt19937_64 random(7);
  std::normal_distribution<double> normal;
  const int side = static_cast<int>(std::ceil(4.0 * std::sqrt(runs + 1.0)));
  const double half_m = 0.5 * kGridM * (side - 1);
  Graph graph;
  for (int i = 0; i < side * side; ++i) {
    graph.modes.emplace_back(kGridM * (i % side) - half_m, kGridM * (i / side) - half_m);
  }
  for (int r = 0; r < runs; ++r) {
    GraphRun run;
    run.correction_prior_sd = Eigen::Vector3d(0.1, 0.1, 0.1);
    run.sensor_bias_sd = SensorBias(0.02, 0.05, 0.1);
    Se2 truth(0.0, 0.0, normal(random));
    double yaw_rate = 0.0;
    for (int i = 0; i < kFrames; ++i) {
      if (i > 0) {
        yaw_rate = 0.95 * yaw_rate + 0.02 * normal(random);
        const Eigen::Vector2d home = truth.Inverse() * Eigen::Vector2d(0.0, 0.0);
        const bool outside = truth.translation().cwiseAbs().maxCoeff() > half_m;
        const double turn = outside ? std::copysign(0.15, home.y()) : yaw_rate;
        const Se2 T_begin_end = Se2::Exp({kStepM, 0.0, turn});
        run.motions.push_back(NoisyMotion(T_begin_end, random));
        truth = truth * T_begin_end;
      }
      run.poses.push_back(
          truth * Se2::Exp(kDisturbed *
                           Eigen::Vector3d(normal(random), normal(random), 0.2 * normal(random))));
      for (const ModeIndex m : graph.modes.indices()) {
        const Eigen::Vector2d q = truth.Inverse() * graph.modes[m];
        if (q.norm() > kRangeM || q.norm() < 0.5 || std::abs(std::atan2(q.y(), q.x())) > 1.0) {
          continue;
        }
        GraphObservation item;
        item.run = RunIndex(r);
        item.frame = FrameIndex(i);
        item.mode = m;
        item.cov_z = Eigen::Vector2d(0.01, 1e-4).asDiagonal();
        item.observation.z = {q.norm() + 0.1 * normal(random),
                              std::atan2(q.y(), q.x()) + 0.01 * normal(random)};
        graph.observations.push_back(item);
      }
    }
    graph.runs.push_back(std::move(run));
  }
  IndexedVector<ModeIndex, std::optional<ModeIndex>> seen(graph.modes.size());
  for (const GraphObservation& item : graph.observations) seen[item.mode] = ModeIndex(0);
  IndexedVector<ModeIndex, Eigen::Vector2d> modes;
  for (const ModeIndex m : graph.modes.indices()) {
    if (!seen[m]) continue;
    seen[m] = modes.end_index();
    modes.push_back(graph.modes[m] + kDisturbed * Eigen::Vector2d(normal(random), normal(random)));
  }
  for (GraphObservation& item : graph.observations) item.mode = *seen[item.mode];
  graph.modes = std::move(modes);
  return graph;
}

std::optional<MapperInput> RecordedRun() {
  const char* data = std::getenv("SHIFTMAP_DATA");
  UtiasOptions options;
  options.dataset_dir = fmt::format("{}/utias/MRCLAM_Dataset3", data == nullptr ? "" : data);
  if (!std::filesystem::exists(options.dataset_dir)) return std::nullopt;
  options.robot = 3;
  options.duration_s = 340.0;
  return MapperInput{"run", "run", ReadUtias(options).value().run};
}

// The graph of the recorded run, mapped by itself and then disturbed.
std::optional<Graph> RecordedGraph() {
  static std::optional<MapperInput> input = RecordedRun();
  if (!input) return std::nullopt;
  const std::vector<Signature> signatures = CollectSignatures({&input->run}, {});
  static const MappingRun run = MakeMappingRun(input->run, signatures, FrontEndOptions());
  static BuildState build = MapSingleRun(run, signatures.size(), MapperOptions());
  Graph graph = MakeGraph(MapperOptions(), &build);
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  for (Eigen::Vector2d& mode : graph.modes) {
    mode += kDisturbed * Eigen::Vector2d(normal(random), normal(random));
  }
  for (Se2& pose : graph.runs.front().poses) {
    pose = pose * Se2::Exp(kDisturbed *
                           Eigen::Vector3d(normal(random), normal(random), 0.2 * normal(random)));
  }
  return graph;
}

// Made once; null where there is no data.
const Graph* GraphOf(benchmark::State& state) {
  static std::map<std::int64_t, std::optional<Graph>> graphs;
  const std::int64_t runs = state.range(0);
  const auto [it, inserted] = graphs.try_emplace(runs);
  if (inserted) it->second = runs == 0 ? RecordedGraph() : MakeFloor(static_cast<int>(runs));
  if (!it->second) {
    state.SkipWithError("no data");
    return nullptr;
  }
  double frames = 0.0;
  for (const GraphRun& run : it->second->runs) frames += static_cast<double>(run.poses.size());
  state.counters["key_frames"] = frames;
  return &*it->second;
}

// The same, at the minimum.
const Graph* SolvedGraphOf(benchmark::State& state) {
  static std::map<std::int64_t, Graph> solved;
  const Graph* graph = GraphOf(state);
  if (graph == nullptr) return nullptr;
  const auto [it, inserted] = solved.try_emplace(state.range(0), *graph);
  if (inserted) SolveGraph({.max_iterations = 200, .cost_tolerance = 1e-9}, &it->second);
  return &it->second;
}

double OffMm(const Graph& graph, const Graph& reference) {
  std::vector<PointPair> pairs;
  for (const ModeIndex m : graph.modes.indices()) {
    pairs.push_back({reference.modes[m], graph.modes[m]});
  }
  const Se2 T_reference_graph = AlignRigid2d(pairs).value();
  double worst = 0.0;
  for (const PointPair& pair : pairs) {
    worst = std::max(worst, (pair.p_a - T_reference_graph * pair.p_b).norm());
  }
  return 1e3 * worst;
}

// @param solve  Minimizes a graph and returns its cost.
template <typename Solve>
void MeasureSolve(benchmark::State& state, const Solve& solve) {
  const Graph* start = GraphOf(state);
  if (start == nullptr) return;
  Graph graph = *start;
  const double before = ResetPeak();
  for (auto _ : state) {
    state.PauseTiming();
    graph = *start;
    state.ResumeTiming();
    state.counters["cost"] = solve(&graph);
  }
  state.counters["peak_mib"] = ResidentMib("VmHWM:") - before;
  state.counters["off_mm"] = OffMm(graph, *SolvedGraphOf(state));
}

// From a start 2 cm off to the minimum.
void BM_SolveSchur(benchmark::State& state) {
  MeasureSolve(state, [](Graph* graph) { return SolveGraph(SolverLimits(), graph).final_cost; });
}

void BM_SolveCeres(benchmark::State& state, ceres::SparseLinearAlgebraLibraryType library) {
  MeasureSolve(state, [&](Graph* graph) {
    CeresProblem problem(*graph, CeresProblem::Weighting::kSlope);
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    options.sparse_linear_algebra_library_type = library;
    options.function_tolerance = 1e-5;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem.problem(), &summary);
    problem.CopyTo(graph);
    return summary.final_cost;
  });
}

// One linearization and its factor.
void BM_FactorSchur(benchmark::State& state) {
  const Graph* graph = SolvedGraphOf(state);
  if (graph == nullptr) return;
  const double before = ResetPeak();
  for (auto _ : state) {
    std::unique_ptr<ReducedSystem> reduced;
    benchmark::DoNotOptimize(SchurPosterior::Of(*graph, {}, &reduced));
  }
  state.counters["peak_mib"] = ResidentMib("VmHWM:") - before;
}

template <typename Factor>
void BM_Factor(benchmark::State& state) {
  const Graph* graph = SolvedGraphOf(state);
  if (graph == nullptr) return;
  const double before = ResetPeak();
  for (auto _ : state) {
    const auto J = CeresProblem(*graph, CeresProblem::Weighting::kCurvature).Jacobian();
    Factor factor(Eigen::SparseMatrix<double>(J->transpose() * *J));
    benchmark::DoNotOptimize(factor.info());
  }
  state.counters["peak_mib"] = ResidentMib("VmHWM:") - before;
}

// What a map has of covariance, tiles where modes are many, from the solved graph on.
void BM_Covariance(benchmark::State& state, SolverKind solver) {
  const Graph* solved = SolvedGraphOf(state);
  if (solved == nullptr) return;
  Graph graph = *solved;
  graph.solver = solver;
  const double before = ResetPeak();
  for (auto _ : state) {
    const std::unique_ptr<GraphPosterior> posterior = LinearizeForMap(graph);
    benchmark::DoNotOptimize(MapCovariance(graph, *posterior, 0.0, {}, {}));
  }
  state.counters["peak_mib"] = ResidentMib("VmHWM:") - before;
}

// A whole build of the recorded run.
void BM_Build(benchmark::State& state, SolverKind solver) {
  const std::optional<MapperInput> input = RecordedRun();
  if (!input) {
    state.SkipWithError("no data");
    return;
  }
  MapperOptions options;
  options.solver_kind = solver;
  for (auto _ : state) benchmark::DoNotOptimize(BuildMap({*input}, std::nullopt, options));
}

void Sizes(benchmark::internal::Benchmark* bench) {
  bench->Unit(benchmark::kMillisecond)->Arg(0)->Arg(1)->Arg(7)->Arg(30);
  if (std::getenv("SHIFTMAP_BENCH_LARGE") != nullptr) bench->Arg(77);
}

BENCHMARK(BM_SolveSchur)->Apply(Sizes);
BENCHMARK_CAPTURE(BM_SolveCeres, eigen, ceres::EIGEN_SPARSE)->Apply(Sizes);
BENCHMARK_CAPTURE(BM_SolveCeres, suitesparse, ceres::SUITE_SPARSE)->Apply(Sizes);
BENCHMARK(BM_FactorSchur)->Apply(Sizes);
BENCHMARK(BM_Factor<Eigen::SimplicialLLT<Eigen::SparseMatrix<double>>>)->Apply(Sizes);
BENCHMARK(BM_Factor<Eigen::CholmodSupernodalLLT<Eigen::SparseMatrix<double>>>)->Apply(Sizes);
BENCHMARK_CAPTURE(BM_Covariance, schur, SolverKind::kSchur)->Apply(Sizes);
BENCHMARK_CAPTURE(BM_Covariance, ceres, SolverKind::kCeres)->Apply(Sizes);
BENCHMARK_CAPTURE(BM_Build, schur, SolverKind::kSchur)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(BM_Build, ceres, SolverKind::kCeres)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace shiftmap
