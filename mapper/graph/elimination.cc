// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/elimination.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <numeric>
#include <utility>

#include "mapper/graph/random_signs.h"
#include "mapper/parallel.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// Draws of the calibrations for what they add to the covariance of modes, a small part of it.
constexpr int kCalibrationDraws = 32;

// Columns of a segment's boundary.
constexpr int kBefore = 0;
constexpr int kAfter = 3;
constexpr int kCorrection = 6;
constexpr int kBias = 9;  // Its first, the scale of ranges, is in factors of motion too.
constexpr int kModes = 12;

// Where a variable of a factor is: a pose of the segment, or a column of its boundary.
struct Place {
  int pose = -1;
  int column = -1;
};

// The normal equations of one factor of three variables a, b and c, worked out for all of them at
// once: J = (J_a, J_b, J_c, r), and the upper triangle of w Jᵀ J.
template <int kRows, int kA, int kB, int kC>
class FactorProducts {
 public:
  template <typename JacobianA, typename JacobianB, typename JacobianC, typename Residual>
  FactorProducts(const Residual& r,
                 const JacobianA& J_a,
                 const JacobianB& J_b,
                 const JacobianC& J_c,
                 double weight = 1.0) {
    if constexpr (kWidth > kEnd + 1) J_.template rightCols<1>().setZero();
    J_.template leftCols<kA>() = J_a;
    J_.template middleCols<kB>(kA) = J_b;
    J_.template middleCols<kC>(kA + kB) = J_c;
    J_.col(kEnd) = r;
    FillRows(weight, std::make_integer_sequence<int, kEnd>());
  }

  // Adds it up. Precondition: poses of the segment are given in their order and before columns of
  // the boundary; of these each is after those before it, but for a before a pose.
  void AddTo(const Place& a, const Place& b, const Place& c, SegmentSystem* out) const {
    AddSelf<0, kA>(a, out);
    AddSelf<kA, kB>(b, out);
    AddSelf<kA + kB, kC>(c, out);
    AddPair<0, kA, kA, kB>(a, b, out);
    AddPair<0, kA, kA + kB, kC>(a, c, out);
    AddPair<kA, kB, kA + kB, kC>(b, c, out);
  }

 private:
  static constexpr int kEnd = kA + kB + kC;  // The column of the residual.
  static constexpr int kWidth = (kEnd + 2) / 2 * 2;

  template <int... kRow>
  void FillRows(double weight, std::integer_sequence<int, kRow...>) {
    (FillRow<kRow>(weight), ...);
  }

  template <int kRow>
  void FillRow(double weight) {
    constexpr int kFirst = kRow / 2 * 2;
    constexpr int kCount = kWidth - kFirst;
    auto row = H_.template block<1, kCount>(kRow, kFirst);
    if constexpr (kRows == 2) {
      row = weight * J_(0, kRow) * J_.template block<1, kCount>(0, kFirst) +
            weight * J_(1, kRow) * J_.template block<1, kCount>(1, kFirst);
    } else {
      static_assert(kRows == 3);
      row = weight * J_(0, kRow) * J_.template block<1, kCount>(0, kFirst) +
            weight * J_(1, kRow) * J_.template block<1, kCount>(1, kFirst) +
            weight * J_(2, kRow) * J_.template block<1, kCount>(2, kFirst);
    }
  }

  // A variable with itself, in the lower triangle, and its gradient.
  template <int kAt, int kSize>
  void AddSelf(const Place& a, SegmentSystem* out) const {
    for (int i = 0; i < kSize; ++i) {
      const double gradient = H_(kAt + i, kEnd);
      if (a.pose >= 0) {
        out->b[3 * a.pose + i] -= gradient;
      } else {
        out->c[a.column + i] -= gradient;
      }
      for (int j = i; j < kSize; ++j) {
        const double value = H_(kAt + i, kAt + j);
        if (a.pose >= 0) {
          if constexpr (kSize == 3) out->A[static_cast<std::size_t>(a.pose)](j, i) += value;
        } else {
          out->C(a.column + j, a.column + i) += value;
        }
      }
    }
  }

  template <int kAtA, int kSizeA, int kAtB, int kSizeB>
  void AddPair(const Place& a, const Place& b, SegmentSystem* out) const {
    const auto product = H_.template block<kSizeA, kSizeB>(kAtA, kAtB);
    if (a.pose >= 0 && b.pose >= 0) {
      if constexpr (kSizeA == 3 && kSizeB == 3) {
        out->E[static_cast<std::size_t>(a.pose)] += product;
      }
    } else if (a.pose >= 0) {
      out->B.block<kSizeA, kSizeB>(3 * a.pose, b.column) += product;
    } else if (b.pose >= 0) {
      out->B.block<kSizeB, kSizeA>(3 * b.pose, a.column) += product.transpose();
    } else {
      out->C.block<kSizeB, kSizeA>(b.column, a.column) += product.transpose();
    }
  }

  Eigen::Matrix<double, kRows, kWidth, Eigen::RowMajor> J_;
  Eigen::Matrix<double, kEnd, kWidth, Eigen::RowMajor> H_;
};

// Of a frame in the stretch [first, last].
Place PlaceOf(int frame, int first, int last) {
  if (frame == first) return {-1, kBefore};
  if (frame == last) return {-1, kAfter};
  return {frame - first - 1, -1};
}

// What is left of a stretch over its boundary.
struct EliminatedStretch {
  Eigen::MatrixXd C;
  Eigen::VectorXd c;
  double cost = 0.0;
  bool determined = false;
};

}  // namespace

GraphStep Scaled(GraphStep step, double factor) {
  for (Eigen::VectorXd& poses : step.poses) poses *= factor;
  for (auto& calibration : step.calibrations) calibration *= factor;
  step.modes *= factor;
  return step;
}

void Apply(const GraphStep& step, Graph* graph) {
  for (std::size_t r = 0; r < graph->runs.size(); ++r) {
    GraphRun& run = graph->runs[r];
    for (std::size_t i = 0; i < run.poses.size(); ++i) {
      run.poses[i] =
          run.poses[i] * Se2::Exp(step.poses[r].segment<3>(static_cast<Eigen::Index>(3 * i)));
    }
    run.correction += step.calibrations[r].head<3>();
    run.sensor_bias += step.calibrations[r].tail<3>();
  }
  for (std::size_t m = 0; m < graph->modes.size(); ++m) {
    graph->modes[m] += step.modes.segment<2>(static_cast<Eigen::Index>(2 * m));
  }
}

GraphElimination::GraphElimination(const Graph& graph, std::vector<std::vector<int>> together)
    : graph_(graph), loss_(graph.loss_scale, graph.loss_reach), together_(std::move(together)) {
  for (const GraphRun& run : graph.runs) {
    motions_.emplace_back(run.motions.begin(), run.motions.end());
  }
  observations_.reserve(graph.observations.size());
  for (const GraphObservation& item : graph.observations) observations_.emplace_back(item);
  MakeStretches();
}

GraphElimination::GraphElimination(const Graph& graph, std::unique_ptr<RestSystem> rest)
    : GraphElimination(graph) {
  if (rest && rest->size() == RestSize() && rest->border() == Calibrations()) {
    rest_ = std::move(rest);
  }
}

int GraphElimination::RestSize() const {
  return first_mode_ + 2 * static_cast<int>(graph_.modes.size());
}

Border GraphElimination::Calibrations() const {
  return {first_calibration_, static_cast<int>(graph_.runs.size()), kRunCalibration, true};
}

void GraphElimination::MakeStretches() {
  std::vector<std::vector<std::size_t>> stretch_of_frame(graph_.runs.size());
  int rest = 0;
  for (std::size_t r = 0; r < graph_.runs.size(); ++r) {
    const auto frames = static_cast<int>(graph_.runs[r].poses.size());
    const bool held = graph_.priors.empty() && graph_.anchor_run == static_cast<int>(r);
    int before = held ? -1 : rest;
    rest += held ? 0 : 3;
    stretch_of_frame[r].resize(static_cast<std::size_t>(frames));
    for (int first = 0; first == 0 || first + 1 < frames;) {
      Stretch stretch;
      stretch.run = static_cast<int>(r);
      stretch.first = first;
      stretch.last = std::min(first + kSegmentPoses + 1, frames - 1);
      const int after = stretch.last > first ? rest : -1;
      if (after >= 0) rest += 3;
      for (int i = 0; i < 3; ++i) stretch.boundary.push_back(before < 0 ? -1 : before + i);
      for (int i = 0; i < 3; ++i) stretch.boundary.push_back(after < 0 ? -1 : after + i);
      for (int frame = first; frame <= stretch.last; ++frame) {
        if (frame == stretch.last && frame + 1 < frames) break;
        stretch_of_frame[r][static_cast<std::size_t>(frame)] = stretches_.size();
      }
      stretches_.push_back(std::move(stretch));
      before = after;
      first = stretches_.back().last;
      if (frames == 1) break;
    }
  }
  first_calibration_ = rest;
  first_mode_ = rest + kRunCalibration * static_cast<int>(graph_.runs.size());
  for (Stretch& stretch : stretches_) {
    for (int i = 0; i < kRunCalibration; ++i) {
      stretch.boundary.push_back(first_calibration_ + kRunCalibration * stretch.run + i);
    }
  }
  for (std::size_t i = 0; i < graph_.observations.size(); ++i) {
    const GraphObservation& item = graph_.observations[i];
    const std::size_t at =
        stretch_of_frame[static_cast<std::size_t>(item.run)][static_cast<std::size_t>(item.frame)];
    stretches_[at].observations.push_back(static_cast<int>(i));
    AddMode(item.mode, &stretches_[at]);
  }
}

void GraphElimination::AddMode(int mode, Stretch* stretch) {
  const int row = first_mode_ + 2 * mode;
  auto found = std::find(stretch->boundary.begin() + kModes, stretch->boundary.end(), row);
  const auto column = static_cast<int>(found - stretch->boundary.begin());
  if (found == stretch->boundary.end()) {
    stretch->boundary.push_back(row);
    stretch->boundary.push_back(row + 1);
  }
  stretch->slots.push_back(column);
}

bool GraphElimination::Eliminate(Weighting weighting, double damping) {
  if (rest_) {
    rest_->Clear();
  } else {
    rest_ = std::make_unique<RestSystem>(RestSize(), Calibrations());
  }
  weighting_ = weighting;
  cost_ = PriorCost();
  AddPriors();
  AddTogether(rest_.get());
  std::vector<EliminatedStretch> eliminated(stretches_.size());
  ForEachIndex(stretches_.size(), graph_.threads, [&](std::size_t i) {
    Stretch& stretch = stretches_[i];
    SegmentSystem system(std::max(0, stretch.last - stretch.first - 1),
                         static_cast<int>(stretch.boundary.size()));
    EliminatedStretch& result = eliminated[i];
    result.cost = LinearizeStretch(stretch, &system);
    if (damping > 0.0) system.Damp(damping);
    result.determined = stretch.segment.Eliminate(&system);
    result.C = std::move(system.C);
    result.c = std::move(system.c);
  });
  for (std::size_t i = 0; i < stretches_.size(); ++i) {
    if (!eliminated[i].determined) return false;
    cost_ += eliminated[i].cost;
    rest_->Add(stretches_[i].boundary, std::move(eliminated[i].C), eliminated[i].c);
  }
  return std::isfinite(cost_);
}

std::vector<Eigen::Matrix2d> GraphElimination::RotationsOf(const Stretch& stretch) const {
  const std::vector<Se2>& poses = graph_.runs[static_cast<std::size_t>(stretch.run)].poses;
  std::vector<Eigen::Matrix2d> rotations;
  rotations.reserve(static_cast<std::size_t>(stretch.last - stretch.first) + 1);
  for (int i = stretch.first; i <= stretch.last; ++i) {
    rotations.push_back(poses[static_cast<std::size_t>(i)].Rotation());
  }
  return rotations;
}

// The motion from a frame of a stretch to the next.
// @param R_map_vehicle  RotationsOf(stretch), here and below.
MotionResidual::Linear GraphElimination::MotionAt(const Stretch& stretch,
                                                  const std::vector<Eigen::Matrix2d>& R_map_vehicle,
                                                  int frame) const {
  const auto r = static_cast<std::size_t>(stretch.run);
  const auto at = static_cast<std::size_t>(frame);
  const GraphRun& run = graph_.runs[r];
  return motions_[r][at].At(run.poses[at],
                            R_map_vehicle[static_cast<std::size_t>(frame - stretch.first)],
                            run.poses[at + 1],
                            run.correction,
                            run.sensor_bias[kLogRangeScale]);
}

// An observation of a stretch.
ObservationResidual::Linear GraphElimination::ObservationAt(
    const Stretch& stretch,
    const std::vector<Eigen::Matrix2d>& R_map_vehicle,
    int observation) const {
  const auto index = static_cast<std::size_t>(observation);
  const GraphObservation& item = graph_.observations[index];
  const GraphRun& run = graph_.runs[static_cast<std::size_t>(stretch.run)];
  return observations_[index].At(
      run.poses[static_cast<std::size_t>(item.frame)],
      R_map_vehicle[static_cast<std::size_t>(item.frame - stretch.first)],
      graph_.modes[static_cast<std::size_t>(item.mode)],
      run.sensor_bias);
}

double GraphElimination::LinearizeStretch(const Stretch& stretch, SegmentSystem* system) const {
  const auto place_of = [&](int frame) { return PlaceOf(frame, stretch.first, stretch.last); };
  const std::vector<Eigen::Matrix2d> R_map_vehicle = RotationsOf(stretch);
  double cost = 0.0;
  for (int i = stretch.first; i < stretch.last; ++i) {
    const MotionResidual::Linear linear = MotionAt(stretch, R_map_vehicle, i);
    const FactorProducts<3, 3, 3, 4> products(
        linear.r, linear.J_i, linear.J_j, linear.J_calibration);
    products.AddTo(place_of(i), place_of(i + 1), Place{-1, kCorrection}, system);
    cost += 0.5 * linear.r.squaredNorm();
  }
  for (std::size_t k = 0; k < stretch.observations.size(); ++k) {
    const int index = stretch.observations[k];
    const ObservationResidual::Linear linear = ObservationAt(stretch, R_map_vehicle, index);
    const double squared = linear.r.squaredNorm();
    cost += loss_.HalfLoss(squared);
    // The slope is by the weight, whatever the matrix is by.
    const double weight = WeightOf(squared);
    const FactorProducts<2, 3, 3, 2> products(
        Eigen::Vector2d(loss_.Slope(squared) / weight * linear.r),
        linear.J_pose,
        linear.J_bias,
        linear.J_landmark,
        weight);
    const int frame = graph_.observations[static_cast<std::size_t>(index)].frame;
    products.AddTo(place_of(frame), Place{-1, kBias}, Place{-1, stretch.slots[k]}, system);
  }
  return cost;
}

double GraphElimination::StretchCost(const Stretch& stretch) const {
  const auto r = static_cast<std::size_t>(stretch.run);
  const GraphRun& run = graph_.runs[r];
  const std::vector<Eigen::Matrix2d> R_map_vehicle = RotationsOf(stretch);
  double cost = 0.0;
  for (int i = stretch.first; i < stretch.last; ++i) {
    const auto at = static_cast<std::size_t>(i);
    cost += 0.5 * motions_[r][at]
                      .ResidualAt(run.poses[at],
                                  R_map_vehicle[static_cast<std::size_t>(i - stretch.first)],
                                  run.poses[at + 1],
                                  run.correction,
                                  run.sensor_bias[kLogRangeScale])
                      .squaredNorm();
  }
  for (const int observation : stretch.observations) {
    const auto index = static_cast<std::size_t>(observation);
    const GraphObservation& item = graph_.observations[index];
    cost += loss_.HalfLoss(
        observations_[index]
            .ResidualAt(run.poses[static_cast<std::size_t>(item.frame)],
                        R_map_vehicle[static_cast<std::size_t>(item.frame - stretch.first)],
                        graph_.modes[static_cast<std::size_t>(item.mode)],
                        run.sensor_bias)
            .squaredNorm());
  }
  return cost;
}

double GraphElimination::PresentCost() const {
  std::vector<double> costs(stretches_.size());
  ForEachIndex(stretches_.size(), graph_.threads, [&](std::size_t i) {
    costs[i] = StretchCost(stretches_[i]);
  });
  return std::accumulate(costs.begin(), costs.end(), PriorCost());
}

double GraphElimination::PriorCost() const {
  double cost = 0.0;
  for (const GraphRun& run : graph_.runs) {
    const Eigen::Vector3d difference = run.correction - run.correction_prior_mean;
    cost += 0.5 * difference.cwiseQuotient(run.correction_prior_sd).squaredNorm() +
            0.5 * run.sensor_bias.cwiseQuotient(run.sensor_bias_sd).squaredNorm();
  }
  for (const GraphPrior& prior : graph_.priors) {
    cost += 0.5 * (prior.sqrt_information * PriorDifference(prior)).squaredNorm();
  }
  return cost;
}

Eigen::VectorXd GraphElimination::PriorDifference(const GraphPrior& prior) const {
  Eigen::VectorXd difference(prior.mean.size());
  for (std::size_t i = 0; i < prior.modes.size(); ++i) {
    const auto at = static_cast<Eigen::Index>(2 * i);
    difference.segment<2>(at) =
        graph_.modes[static_cast<std::size_t>(prior.modes[i])] - prior.mean.segment<2>(at);
  }
  return difference;
}

void GraphElimination::AddPriors() {
  for (std::size_t r = 0; r < graph_.runs.size(); ++r) {
    const GraphRun& run = graph_.runs[r];
    Eigen::Vector<double, kRunCalibration> information;
    information << run.correction_prior_sd.cwiseAbs2().cwiseInverse(),
        run.sensor_bias_sd.cwiseAbs2().cwiseInverse();
    Eigen::Vector<double, kRunCalibration> difference;
    difference << run.correction - run.correction_prior_mean, run.sensor_bias;
    std::vector<int> index;
    for (int i = 0; i < kRunCalibration; ++i) {
      index.push_back(first_calibration_ + kRunCalibration * static_cast<int>(r) + i);
    }
    rest_->Add(index, information.asDiagonal(), -information.cwiseProduct(difference));
  }
  for (const GraphPrior& prior : graph_.priors) {
    rest_->Add(
        RowsOf(prior.modes), prior.information, -(prior.information * PriorDifference(prior)));
  }
}

std::vector<int> GraphElimination::RowsOf(const std::vector<int>& modes) const {
  std::vector<int> rows;
  for (const int mode : modes) {
    rows.insert(rows.end(), {first_mode_ + 2 * mode, first_mode_ + 2 * mode + 1});
  }
  return rows;
}

// Terms of zeros: they have places in the factor.
void GraphElimination::AddTogether(RestSystem* rest) const {
  for (const std::vector<int>& modes : together_) {
    const std::vector<int> rows = RowsOf(modes);
    const auto size = static_cast<Eigen::Index>(rows.size());
    rest->Add(rows, Eigen::MatrixXd::Zero(size, size), Eigen::VectorXd::Zero(size));
  }
}

GraphStep GraphElimination::Complete(const Eigen::VectorXd& rest, const Inside& inside) const {
  GraphStep step;
  for (const GraphRun& run : graph_.runs) {
    step.poses.emplace_back(Eigen::VectorXd::Zero(static_cast<Eigen::Index>(3 * run.poses.size())));
  }
  for (std::size_t s = 0; s < stretches_.size(); ++s) {
    const Stretch& stretch = stretches_[s];
    Eigen::VectorXd boundary(static_cast<Eigen::Index>(stretch.boundary.size()));
    for (std::size_t i = 0; i < stretch.boundary.size(); ++i) {
      const int row = stretch.boundary[i];
      boundary[static_cast<Eigen::Index>(i)] = row < 0 ? 0.0 : rest[row];
    }
    Eigen::VectorXd& poses = step.poses[static_cast<std::size_t>(stretch.run)];
    poses.segment<3>(Eigen::Index{3} * stretch.first) = boundary.segment<3>(kBefore);
    if (stretch.last > stretch.first) {
      poses.segment<3>(Eigen::Index{3} * stretch.last) = boundary.segment<3>(kAfter);
    }
    const int count = stretch.segment.poses();
    if (count == 0) continue;
    poses.segment(Eigen::Index{3} * (stretch.first + 1), Eigen::Index{3} * count) =
        inside(s, boundary);
  }
  for (std::size_t r = 0; r < graph_.runs.size(); ++r) {
    step.calibrations.emplace_back(rest.segment<kRunCalibration>(
        first_calibration_ + kRunCalibration * static_cast<Eigen::Index>(r)));
  }
  step.modes = rest.tail(static_cast<Eigen::Index>(2 * graph_.modes.size()));
  return step;
}

std::optional<GraphStep> GraphElimination::SimilarStep() {
  const std::optional<Eigen::VectorXd> rest = rest_->SolveSimilar();
  if (!rest) return std::nullopt;
  expected_decrease_ = rest_->right_side().dot(*rest);
  for (const Stretch& stretch : stretches_) expected_decrease_ += stretch.segment.Decrease();
  expected_decrease_ *= 0.5;
  return Complete(*rest, [&](std::size_t i, const Eigen::VectorXd& boundary) {
    return stretches_[i].segment.Solve(boundary);
  });
}

// Calls for each residual of a stretch with its linearization.
template <typename AddMotion, typename AddObservation>
void GraphElimination::VisitResiduals(const Stretch& stretch,
                                      const AddMotion& add_motion,
                                      const AddObservation& add_observation) const {
  const std::vector<Eigen::Matrix2d> R_map_vehicle = RotationsOf(stretch);
  for (int i = stretch.first; i < stretch.last; ++i) {
    add_motion(i, MotionAt(stretch, R_map_vehicle, i));
  }
  for (std::size_t o = 0; o < stretch.observations.size(); ++o) {
    const ObservationResidual::Linear linear =
        ObservationAt(stretch, R_map_vehicle, stretch.observations[o]);
    add_observation(o, std::sqrt(WeightOf(linear.r.squaredNorm())), linear);
  }
}

// Jᵀ ε of one stretch, a column of the right sides for each of several ε.
class GraphElimination::NoiseSum {
 public:
  NoiseSum(const Stretch& stretch, PoseRows* b, Eigen::MatrixXd* c)
      : stretch_(stretch), b_(*b), c_(*c) {}

  void AddMotion(Eigen::Index column,
                 int frame,
                 const MotionResidual::Linear& linear,
                 const Eigen::Vector3d& noise) {
    AddPose(column, frame, linear.J_i.transpose() * noise);
    AddPose(column, frame + 1, linear.J_j.transpose() * noise);
    c_.block<4, 1>(kCorrection, column) += linear.J_calibration.transpose() * noise;
  }

  void AddObservation(Eigen::Index column,
                      int frame,
                      int slot,
                      const ObservationResidual::Linear& linear,
                      const Eigen::Vector2d& noise) {
    AddPose(column, frame, linear.J_pose.transpose() * noise);
    c_.block<3, 1>(kBias, column) += linear.J_bias.transpose() * noise;
    c_.block<2, 1>(slot, column) += linear.J_landmark.transpose() * noise;
  }

 private:
  void AddPose(Eigen::Index column, int frame, const Eigen::Vector3d& gradient) {
    const Place place = PlaceOf(frame, stretch_.first, stretch_.last);
    if (place.pose >= 0) {
      b_.block<3, 1>(Eigen::Index{3} * place.pose, column) += gradient;
    } else {
      c_.block<3, 1>(place.column, column) += gradient;
    }
  }

  const Stretch& stretch_;
  PoseRows& b_;
  Eigen::MatrixXd& c_;
};

// H⁻¹ Jᵀ ε of separators, calibrations and modes.
// @param rest    Jᵀ ε of the priors, a column each.
// @param inside  Per stretch what Complete() needs for the poses.
Eigen::MatrixXd GraphElimination::SolveNoise(const NoiseOf& add_noise,
                                             Eigen::MatrixXd rest,
                                             std::vector<PoseRows>* inside) const {
  inside->resize(stretches_.size());
  std::vector<Eigen::MatrixXd> c(stretches_.size());
  ForEachIndex(stretches_.size(), graph_.threads, [&](std::size_t i) {
    const Stretch& stretch = stretches_[i];
    PoseRows& u = (*inside)[i];
    u.setZero(Eigen::Index{3} * stretch.segment.poses(), rest.cols());
    c[i].setZero(std::ssize(stretch.boundary), rest.cols());
    add_noise(stretch, &u, &c[i]);
    stretch.segment.Eliminate(&u, &c[i]);
  });
  for (std::size_t i = 0; i < stretches_.size(); ++i) {
    for (std::size_t row = 0; row < stretches_[i].boundary.size(); ++row) {
      const int unknown = stretches_[i].boundary[row];
      if (unknown >= 0) rest.row(unknown) += c[i].row(static_cast<Eigen::Index>(row));
    }
  }
  return rest_->SolveForDraws(rest);
}

std::vector<ResidualDraw> GraphElimination::DrawResiduals(int count,
                                                          std::mt19937_64& random) const {
  RandomSigns signs(&random);
  std::vector<ResidualDraw> draws(static_cast<std::size_t>(count));
  for (ResidualDraw& draw : draws) {
    for (const GraphRun& run : graph_.runs)
      signs.Fill(std::ssize(run.motions), &draw.noise.motions.emplace_back());
    signs.Fill(std::ssize(graph_.observations), &draw.noise.observations);
  }
  const auto add_noise = [&](const Stretch& stretch, PoseRows* b, Eigen::MatrixXd* c) {
    const auto r = static_cast<std::size_t>(stretch.run);
    NoiseSum sum(stretch, b, c);
    VisitResiduals(
        stretch,
        [&](int frame, const MotionResidual::Linear& linear) {
          for (Eigen::Index k = 0; k < count; ++k) {
            const GraphResiduals& noise = draws[static_cast<std::size_t>(k)].noise;
            sum.AddMotion(k, frame, linear, noise.motions[r].col(frame));
          }
        },
        [&](std::size_t o, double root, const ObservationResidual::Linear& linear) {
          const int index = stretch.observations[o];
          const int frame = graph_.observations[static_cast<std::size_t>(index)].frame;
          for (Eigen::Index k = 0; k < count; ++k) {
            const GraphResiduals& noise = draws[static_cast<std::size_t>(k)].noise;
            sum.AddObservation(
                k, frame, stretch.slots[o], linear, root * noise.observations.col(index));
          }
        });
  };
  std::vector<PoseRows> inside;
  const Eigen::MatrixXd rest = SolveNoise(add_noise, PriorNoise(count, random), &inside);
  for (int k = 0; k < count; ++k) {
    draws[static_cast<std::size_t>(k)].step =
        Complete(rest.col(k), [&](std::size_t i, const Eigen::VectorXd& boundary) {
          return stretches_[i].segment.BackSubstitute(inside[i].col(k), boundary);
        });
  }
  return draws;
}

std::vector<GraphResiduals> GraphElimination::Left(const std::vector<ResidualDraw>& draws) const {
  std::vector<GraphResiduals> left;
  for (const ResidualDraw& draw : draws) left.push_back(draw.noise);
  for (const Stretch& stretch : stretches_) {
    const auto r = static_cast<std::size_t>(stretch.run);
    const auto pose = [&](const GraphStep& step, int frame) {
      return step.poses[r].segment<3>(Eigen::Index{3} * frame);
    };
    VisitResiduals(
        stretch,
        [&](int frame, const MotionResidual::Linear& linear) {
          for (std::size_t k = 0; k < draws.size(); ++k) {
            const GraphStep& step = draws[k].step;
            left[k].motions[r].col(frame) -= linear.J_i * pose(step, frame) +
                                             linear.J_j * pose(step, frame + 1) +
                                             linear.J_calibration * step.calibrations[r].head<4>();
          }
        },
        [&](std::size_t o, double root, const ObservationResidual::Linear& linear) {
          const int index = stretch.observations[o];
          const GraphObservation& item = graph_.observations[static_cast<std::size_t>(index)];
          for (std::size_t k = 0; k < draws.size(); ++k) {
            const GraphStep& step = draws[k].step;
            left[k].observations.col(index) -=
                root * (linear.J_pose * pose(step, item.frame) +
                        linear.J_bias * step.calibrations[r].tail<3>() +
                        linear.J_landmark * step.modes.segment<2>(Eigen::Index{2} * item.mode));
          }
        });
  }
  return left;
}

Eigen::MatrixXd GraphElimination::ModeStepsByBlock(const GraphResiduals& residuals,
                                                   const FrameBlocks& block_of_frame,
                                                   int blocks) const {
  const auto add_noise = [&](const Stretch& stretch, PoseRows* b, Eigen::MatrixXd* c) {
    const auto r = static_cast<std::size_t>(stretch.run);
    NoiseSum sum(stretch, b, c);
    VisitResiduals(
        stretch,
        [&](int frame, const MotionResidual::Linear& linear) {
          sum.AddMotion(block_of_frame[r][static_cast<std::size_t>(frame)],
                        frame,
                        linear,
                        residuals.motions[r].col(frame));
        },
        [&](std::size_t o, double root, const ObservationResidual::Linear& linear) {
          const int index = stretch.observations[o];
          const int frame = graph_.observations[static_cast<std::size_t>(index)].frame;
          sum.AddObservation(block_of_frame[r][static_cast<std::size_t>(frame)],
                             frame,
                             stretch.slots[o],
                             linear,
                             root * residuals.observations.col(index));
        });
  };
  std::vector<PoseRows> inside;
  return SolveNoise(add_noise, Eigen::MatrixXd::Zero(rest_->size(), blocks), &inside)
      .bottomRows(static_cast<Eigen::Index>(2 * graph_.modes.size()));
}

// Jᵀ ε of the priors, a column a draw, over the rest.
Eigen::MatrixXd GraphElimination::PriorNoise(int count, std::mt19937_64& random) const {
  RandomSigns signs(&random);
  Eigen::MatrixXd right = Eigen::MatrixXd::Zero(rest_->size(), count);
  for (std::size_t r = 0; r < graph_.runs.size(); ++r) {
    const GraphRun& run = graph_.runs[r];
    Eigen::Matrix<double, kRunCalibration, Eigen::Dynamic> noise;
    signs.Fill(count, &noise);
    const Eigen::Index row = first_calibration_ + kRunCalibration * static_cast<Eigen::Index>(r);
    right.middleRows<3>(row) =
        run.correction_prior_sd.cwiseInverse().asDiagonal() * noise.topRows<3>();
    right.middleRows<3>(row + 3) =
        run.sensor_bias_sd.cwiseInverse().asDiagonal() * noise.bottomRows<3>();
  }
  for (const GraphPrior& prior : graph_.priors) {
    Eigen::MatrixXd noise(prior.sqrt_information.rows(), count);
    signs.Fill(count, &noise);
    right(RowsOf(prior.modes), Eigen::all) += prior.sqrt_information.transpose() * noise;
  }
  return right;
}

Eigen::MatrixXd GraphElimination::CalibrationInformationTimes(
    const Eigen::MatrixXd& weights) const {
  return rest_->BorderInformationTimes(weights);
}

Eigen::MatrixXd GraphElimination::ModeCovariance() const {
  return rest_->TailCovariance(static_cast<int>(2 * graph_.modes.size()));
}

Eigen::MatrixXd GraphElimination::ModeCovarianceTimes(const Eigen::MatrixXd& weights) const {
  Eigen::MatrixXd right = Eigen::MatrixXd::Zero(rest_->size(), weights.cols());
  right.bottomRows(weights.rows()) = weights;
  return rest_->SolveFor(right).bottomRows(weights.rows());
}

// A scale that is held with the information w goes where it is pushed by w times its way, and all
// others follow. Beside a factor without calibrations, odometry's scale is taken along by hand:
// where ranges read too much the world is smaller, and odometry makes too much of it.
Eigen::MatrixXd GraphElimination::ModesByRangeScale(
    const std::vector<std::vector<std::size_t>>& runs) const {
  constexpr int kScaleOfRanges = 3 + kLogRangeScale;  // After the correction.
  constexpr int kScaleOfOdometry = 0;
  const bool held = HoldsCalibrations();
  Eigen::MatrixXd c = Eigen::MatrixXd::Zero(
      static_cast<Eigen::Index>(kRunCalibration * graph_.runs.size()), std::ssize(runs));
  for (std::size_t column = 0; column < runs.size(); ++column) {
    for (const std::size_t r : runs[column]) {
      const double sd = graph_.runs[r].sensor_bias_sd[kLogRangeScale];
      auto of_run = c.col(static_cast<Eigen::Index>(column))
                        .segment<kRunCalibration>(static_cast<Eigen::Index>(kRunCalibration * r));
      of_run[kScaleOfRanges] = held ? 1.0 : 1.0 / (sd * sd);
      of_run[kScaleOfOdometry] = held ? -1.0 : 0.0;
    }
  }
  const auto modes = static_cast<Eigen::Index>(2 * graph_.modes.size());
  if (held) return rest_->FollowBorder(c).bottomRows(modes);
  Eigen::MatrixXd right = Eigen::MatrixXd::Zero(rest_->size(), c.cols());
  right.middleRows(first_calibration_, c.rows()) = c;
  return rest_->SolveFor(right).bottomRows(modes);
}

Eigen::Matrix2d GraphElimination::ModeDifferenceCovariance(int a, int b) const {
  const int i = first_mode_ + 2 * a;
  const int j = first_mode_ + 2 * b;
  Eigen::Matrix<double, 4, 2> difference;
  difference << Eigen::Matrix2d::Identity(), -Eigen::Matrix2d::Identity();
  return rest_->QuadraticForm({i, i + 1, j, j + 1}, difference);
}

Eigen::MatrixXd GraphElimination::DrawModes(int draws, std::mt19937_64& random) const {
  std::normal_distribution<double> normal;
  Eigen::MatrixXd z(rest_->factored_size(), draws);
  for (double& value : z.reshaped()) value = normal(random);
  return rest_->DrawTail(static_cast<int>(2 * graph_.modes.size()), z);
}

Eigen::MatrixXd GraphElimination::CalibrationRoot() const {
  const auto rows = static_cast<Eigen::Index>(2 * graph_.modes.size());
  if (!HoldsCalibrations()) return Eigen::MatrixXd(rows, 0);
  std::mt19937_64 random(1);
  const Eigen::MatrixXd draws = rest_->DrawColumns(kCalibrationDraws, random);
  const auto calibrations = draws.middleRows(first_calibration_, first_mode_ - first_calibration_);
  return rest_->FollowBorderAsVisited(calibrations).bottomRows(rows) / std::sqrt(kCalibrationDraws);
}

Eigen::MatrixXd GraphElimination::VisitedCovarianceTimes(const Eigen::MatrixXd& calibration_root,
                                                         const Eigen::MatrixXd& weights) const {
  if (!HoldsCalibrations()) return ModeCovarianceTimes(weights);
  Eigen::MatrixXd right = Eigen::MatrixXd::Zero(rest_->size(), weights.cols());
  right.bottomRows(weights.rows()) = weights;
  return rest_->SolveHeld(right).bottomRows(weights.rows()) +
         calibration_root * (calibration_root.transpose() * weights);
}

void GraphElimination::VisitModeCovariance(const Eigen::MatrixXd& calibration_root,
                                           const BlockVisitor& visitor) const {
  const auto block_of = [&](int a, int b, const Eigen::Matrix2d& held) -> Eigen::Matrix2d {
    return held + calibration_root.middleRows<2>(Eigen::Index{2} * a) *
                      calibration_root.middleRows<2>(Eigen::Index{2} * b).transpose();
  };
  std::vector<std::pair<Eigen::Index, int>> modes;  // Row in the block, mode.
  rest_->VisitInverse([&](const std::vector<int>& unknowns, int own, const Eigen::MatrixXd& block) {
    modes.clear();
    for (std::size_t i = 0; i < unknowns.size(); ++i) {
      const int offset = unknowns[i] - first_mode_;
      if (offset < 0 || offset % 2 != 0) continue;
      modes.emplace_back(static_cast<Eigen::Index>(i), offset / 2);
    }
    for (std::size_t a = 0; a < modes.size() && modes[a].first < own; ++a) {
      const auto [row, mode] = modes[a];
      const Eigen::Matrix2d marginal = block.block<2, 2>(row, row);
      visitor(mode, mode, block_of(mode, mode, Symmetrized(marginal)));
      for (std::size_t b = a + 1; b < modes.size(); ++b) {
        const int other = modes[b].second;
        visitor(mode, other, block_of(mode, other, block.block<2, 2>(row, modes[b].first)));
      }
    }
  });
}

}  // namespace shiftmap
