// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/incremental/fixed_lag_smoother.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <iterator>
#include <utility>

#include "proto/core/check.h"

namespace shiftmap {
namespace {

// Frames eliminated together. More make fewer systems to keep and more to eliminate at every step.
constexpr int kChunkFrames = 8;

// SolveFully() stands still once nothing moves by more than this. [m], [rad]
constexpr double kSettled = 1e-9;
constexpr int kMaxFullIterations = 50;

// Grows a system to more modes, of which it says nothing.
void Resize(Eigen::Index size, CarriedSystem* system) {
  const Eigen::Index before = system->b.size();
  if (before >= size) return;
  system->H.conservativeResizeLike(Eigen::MatrixXd::Zero(size, size));
  system->b.conservativeResizeLike(Eigen::VectorXd::Zero(size));
}

// What the quadratic says once the mode at column `from` is the one at column `to`, a distance
// `shift` = origin of `to` - origin of `from` away.
void FoldMode(Eigen::Index from,
              Eigen::Index to,
              const Eigen::Vector2d& shift,
              CarriedSystem* system) {
  Eigen::MatrixXd H = system->H.selfadjointView<Eigen::Lower>();
  system->b -= H.middleCols<2>(from) * shift;
  H.middleCols<2>(to) += H.middleCols<2>(from).eval();
  H.middleRows<2>(to) += H.middleRows<2>(from).eval();
  H.middleCols<2>(from).setZero();
  H.middleRows<2>(from).setZero();
  system->b.segment<2>(to) += system->b.segment<2>(from).eval();
  system->b.segment<2>(from).setZero();
  system->H = std::move(H);
}

}  // namespace

FixedLagSmoother::FixedLagSmoother(const SmootherOptions& options, const PoseWithCovariance& start)
    : options_(options) {
  window_.loss_scale = options.loss_scale;
  window_.calibration = window_.calibration_origin = options.calibration_mean;
  window_.T_map_start = start.T_map_vehicle;
  window_.start.emplace(MotionIncrement{Se2(), start.cov_T_map_vehicle, Eigen::Matrix3d::Zero()});
}

int FixedLagSmoother::AddMode(const Eigen::Vector2d& p_map_landmark, const Eigen::Matrix2d& cov) {
  window_.modes.push_back({p_map_landmark, p_map_landmark, p_map_landmark, cov, false});
  return static_cast<int>(window_.modes.size()) - 1;
}

void FixedLagSmoother::SetPrior(const GraphPrior& prior) { prior_ = prior; }

void FixedLagSmoother::AddFrame() {
  SHIFTMAP_CHECK(window_.frames.empty(), "{} frames before the first", window_.frames.size());
  WindowFrame frame;
  frame.origin = frame.T_map_vehicle = window_.T_map_start;
  window_.frames.push_back(std::move(frame));
}

void FixedLagSmoother::AddFrame(const MotionIncrement& motion) {
  SHIFTMAP_CHECK(!window_.frames.empty(), "a motion, but no frame that it starts from");
  WindowFrame& from = window_.frames.back();
  from.motion.emplace(motion);
  WindowFrame frame;
  frame.origin = from.T_map_vehicle * motion.T_begin_end *
                 Se2::Exp(motion.J_calibration * window_.calibration.head<3>());
  frame.T_map_vehicle = frame.origin;
  window_.frames.push_back(std::move(frame));
  const int newest = static_cast<int>(window_.frames.size()) - 1;
  const bool full = chunks_.empty() || newest - 1 - chunks_.back().first() >= kChunkFrames;
  if (full) {
    chunks_.emplace_back(newest - 1, newest);
  } else {
    chunks_.back().Extend();
  }
  stale_ = std::min(stale_, static_cast<int>(chunks_.size()) - 1);
}

void FixedLagSmoother::AddObservation(WindowObservation observation) {
  window_.frames.back().observations.push_back(std::move(observation));
}

void FixedLagSmoother::Switch(int frame, int observation, int mode) {
  window_.frames[static_cast<std::size_t>(frame)]
      .observations[static_cast<std::size_t>(observation)]
      .mode = mode;
  stale_ = std::min(stale_, ChunkOf(frame));
}

int FixedLagSmoother::ChunkOf(int frame) const {
  const auto after =
      std::upper_bound(chunks_.begin(), chunks_.end(), frame, [](int f, const FrameChunk& chunk) {
        return f < chunk.end();
      });
  return static_cast<int>(after - chunks_.begin());
}

void FixedLagSmoother::MergeModes(int from, int to) {
  WindowMode& gone = window_.modes[static_cast<std::size_t>(from)];
  WindowMode& kept = window_.modes[static_cast<std::size_t>(to)];
  gone.merged = true;
  for (WindowFrame& frame : window_.frames) {
    for (WindowObservation& observation : frame.observations) {
      if (observation.mode == from) observation.mode = to;
    }
  }
  if (dropped_.Knows(ModeColumn(from))) {
    Resize(ModeColumn(std::max(from, to) + 1), &dropped_);
    if (!dropped_.Knows(ModeColumn(to))) kept.origin = gone.origin;
    FoldMode(ModeColumn(from), ModeColumn(to), kept.origin - gone.origin, &dropped_);
  }
  stale_ = 0;
}

const CarriedSystem& FixedLagSmoother::CarriedTo(int chunk) const {
  return chunk == 0 ? dropped_ : chunks_[static_cast<std::size_t>(chunk) - 1].carried();
}

// What the chunks before do not know is linearized at its present estimate.
void FixedLagSmoother::MoveOrigins(int chunk) {
  const CarriedSystem& known = CarriedTo(chunk);
  const auto chunks = static_cast<int>(chunks_.size());
  int frame = chunk < chunks ? chunks_[static_cast<std::size_t>(chunk)].first()
                             : static_cast<int>(window_.frames.size()) - 1;
  if (known.Knows(kPoseColumn)) ++frame;
  for (auto f = static_cast<std::size_t>(frame); f < window_.frames.size(); ++f) {
    window_.frames[f].origin = window_.frames[f].T_map_vehicle;
    window_.frames[f].step.setZero();
  }
  if (!known.Knows(kCorrectionColumn) && !known.Knows(kBiasColumn)) {
    window_.calibration_origin = window_.calibration;
  }
  for (std::size_t m = 0; m < window_.modes.size(); ++m) {
    if (known.Knows(ModeColumn(static_cast<int>(m)))) continue;
    window_.modes[m].origin = window_.modes[m].p_map_landmark;
  }
}

bool FixedLagSmoother::AssembleNewest(CarriedSystem* system) const {
  *system = CarriedTo(static_cast<int>(chunks_.size()));
  Resize(ModeColumn(static_cast<int>(window_.modes.size())), system);
  if (chunks_.empty() && window_.start) {
    const MotionResidual::Linear start = LinearizeStart(window_);
    system->H.topLeftCorner<3, 3>() += start.J_j.transpose() * start.J_j;
    system->b.head<3>() -= start.J_j.transpose() * start.r;
  }
  for (const WindowObservation& observation : newest().observations) {
    if (observation.mode == kNoMode) continue;
    const ObservationResidual::Linear seen = LinearizeObservation(window_, newest(), observation);
    const Eigen::Index column = ModeColumn(observation.mode);
    Eigen::Matrix<double, 2, 8> J;
    J << seen.J_pose, seen.J_bias, seen.J_landmark;
    const std::array<Eigen::Index, 8> at = {
        0, 1, 2, kBiasColumn, kBiasColumn + 1, kBiasColumn + 2, column, column + 1};
    const Eigen::Matrix<double, 8, 8> H = J.transpose() * J;
    const Eigen::Matrix<double, 8, 1> b = -J.transpose() * seen.r;
    for (std::size_t i = 0; i < at.size(); ++i) {
      const auto row = static_cast<Eigen::Index>(i);
      system->b[at[i]] += b[row];
      for (std::size_t j = 0; j <= i; ++j) {
        system->H(at[i], at[j]) += H(row, static_cast<Eigen::Index>(j));
      }
    }
  }
  AddPriors(system);
  return system->H.allFinite() && system->b.allFinite();
}

void FixedLagSmoother::AddPriors(CarriedSystem* system) const {
  const CalibrationVector information = options_.calibration_sd.cwiseAbs2().cwiseInverse();
  system->H.diagonal().segment<kRunCalibration>(kCorrectionColumn) += information;
  system->b.segment<kRunCalibration>(kCorrectionColumn) +=
      information.cwiseProduct(options_.calibration_mean - window_.calibration_origin);
  Eigen::VectorXd from_origin = prior_.mean;
  for (std::size_t i = 0; i < prior_.modes.size(); ++i) {
    from_origin.segment<2>(static_cast<Eigen::Index>(2 * i)) -=
        window_.modes[static_cast<std::size_t>(prior_.modes[i].value())].origin;
  }
  const Eigen::VectorXd b = prior_.information * from_origin;
  for (std::size_t i = 0; i < prior_.modes.size(); ++i) {
    const auto from = static_cast<Eigen::Index>(2 * i);
    const Eigen::Index row = ModeColumn(prior_.modes[i].value());
    system->b.segment<2>(row) += b.segment<2>(from);
    for (std::size_t j = 0; j < prior_.modes.size(); ++j) {
      const Eigen::Index column = ModeColumn(prior_.modes[j].value());
      if (column > row) continue;
      system->H.block<2, 2>(row, column) +=
          prior_.information.block<2, 2>(from, static_cast<Eigen::Index>(2 * j));
    }
  }
  for (std::size_t m = 0; m < window_.modes.size(); ++m) {
    const Eigen::Index column = ModeColumn(static_cast<int>(m));
    if (system->Knows(column)) continue;
    const WindowMode& mode = window_.modes[m];
    const Eigen::Matrix2d birth = mode.birth_cov.inverse();
    system->H.block<2, 2>(column, column) += birth;
    system->b.segment<2>(column) += birth * (mode.birth - mode.origin);
  }
}

bool FixedLagSmoother::SolveOnce() {
  MoveOrigins(stale_);
  for (; stale_ < static_cast<int>(chunks_.size()); ++stale_) {
    if (!chunks_[static_cast<std::size_t>(stale_)].Eliminate(window_, CarriedTo(stale_))) {
      return false;
    }
  }
  CarriedSystem system;
  if (!AssembleNewest(&system)) return false;
  newest_.compute(system.H);
  if (newest_.info() != Eigen::Success) return false;
  const Eigen::VectorXd steps = newest_.solve(system.b);
  if (!steps.allFinite()) return false;
  WindowFrame& frame = window_.frames.back();
  frame.step = steps.segment<3>(kPoseColumn);
  frame.T_map_vehicle = frame.origin * Se2::Exp(frame.step);
  window_.calibration =
      window_.calibration_origin + steps.segment<kRunCalibration>(kCorrectionColumn);
  for (std::size_t m = 0; m < window_.modes.size(); ++m) {
    WindowMode& mode = window_.modes[m];
    mode.p_map_landmark = mode.origin + steps.segment<2>(ModeColumn(static_cast<int>(m)));
  }
  for (std::size_t k = chunks_.size(); k-- > 0;) chunks_[k].BackSubstitute(steps, &window_);
  return true;
}

// The chunk that linearized what has moved too far since: of poses the one behind which they are
// eliminated or, for the first of a chunk, the one that carries them; of modes the first that knows
// them.
FixedLagSmoother::Staleness FixedLagSmoother::FindStale() const {
  const auto chunks = static_cast<int>(chunks_.size());
  Staleness found{chunks, true};
  const auto add = [&](int chunk) {
    found.settled = false;
    found.first_chunk = std::min(found.first_chunk, std::max(chunk, 0));
  };
  const auto moved = [&](const auto& step) {
    return step.cwiseAbs().maxCoeff() > options_.relinearize_threshold;
  };
  for (int f = 0; f < static_cast<int>(window_.frames.size()); ++f) {
    if (!moved(window_.frames[static_cast<std::size_t>(f)].step)) continue;
    if (f == 0 && dropped_.Knows(kPoseColumn)) continue;
    const int chunk = ChunkOf(f);
    const bool carried = chunk == chunks || f == chunks_[static_cast<std::size_t>(chunk)].first();
    add(carried ? chunk - 1 : chunk);
  }
  const bool calibration_held = dropped_.Knows(kCorrectionColumn) || dropped_.Knows(kBiasColumn);
  if (!calibration_held && moved(window_.calibration - window_.calibration_origin)) add(0);
  for (std::size_t m = 0; m < window_.modes.size(); ++m) {
    const WindowMode& mode = window_.modes[m];
    const Eigen::Index column = ModeColumn(static_cast<int>(m));
    if (mode.merged || dropped_.Knows(column)) continue;
    if (!moved(mode.p_map_landmark - mode.origin)) continue;
    int chunk = 0;
    while (chunk < chunks && !CarriedTo(chunk + 1).Knows(column)) ++chunk;
    add(chunk);
  }
  found.first_chunk = std::min(found.first_chunk, chunks);
  return found;
}

bool FixedLagSmoother::Solve(int max_iterations) {
  for (int i = 0; i < max_iterations; ++i) {
    if (!SolveOnce()) return false;
    const Staleness found = FindStale();
    stale_ = found.first_chunk;
    if (found.settled) break;
  }
  return true;
}

bool FixedLagSmoother::SolveFully() {
  std::vector<Se2> before;
  for (int i = 0; i < kMaxFullIterations; ++i) {
    stale_ = 0;
    before.clear();
    for (const WindowFrame& frame : window_.frames) before.push_back(frame.T_map_vehicle);
    if (!SolveOnce()) return false;
    double largest = 0.0;
    for (std::size_t f = 0; f < before.size(); ++f) {
      const Se2 moved = before[f].Inverse() * window_.frames[f].T_map_vehicle;
      largest = std::max(largest, moved.Log().cwiseAbs().maxCoeff());
    }
    if (largest < kSettled) break;
  }
  stale_ = FindStale().first_chunk;
  return true;
}

std::vector<WindowFrame> FixedLagSmoother::DropBefore(int frame) {
  int chunks = 0;
  while (chunks < stale_ && chunks_[static_cast<std::size_t>(chunks)].end() <= frame) ++chunks;
  if (chunks == 0) return {};
  dropped_ = CarriedTo(chunks);
  const int frames = chunks_[static_cast<std::size_t>(chunks) - 1].end();
  const auto first_kept = window_.frames.begin() + frames;
  std::vector<WindowFrame> gone(std::make_move_iterator(window_.frames.begin()),
                                std::make_move_iterator(first_kept));
  window_.frames.erase(window_.frames.begin(), first_kept);
  window_.start.reset();
  chunks_.erase(chunks_.begin(), chunks_.begin() + chunks);
  for (FrameChunk& chunk : chunks_) chunk.Shift(frames);
  stale_ -= chunks;
  return gone;
}

Eigen::MatrixXd FixedLagSmoother::Covariance(const std::vector<Eigen::Index>& columns) const {
  const auto count = static_cast<Eigen::Index>(columns.size());
  Eigen::MatrixXd unit = Eigen::MatrixXd::Zero(newest_.rows(), count);
  for (Eigen::Index i = 0; i < count; ++i) unit(columns[static_cast<std::size_t>(i)], i) = 1.0;
  newest_.matrixL().solveInPlace(unit);
  return unit.transpose() * unit;
}

Eigen::Matrix3d FixedLagSmoother::PoseCovariance() const { return Covariance({0, 1, 2}); }

Eigen::Matrix<double, 5, 5> FixedLagSmoother::PoseModeCovariance(int mode) const {
  const Eigen::Index column = ModeColumn(mode);
  return Covariance({0, 1, 2, column, column + 1});
}

Eigen::Matrix4d FixedLagSmoother::ModePairCovariance(int a, int b) const {
  return Covariance({ModeColumn(a), ModeColumn(a) + 1, ModeColumn(b), ModeColumn(b) + 1});
}

}  // namespace shiftmap
