// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/schur_posterior.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "mapper/graph/random_signs.h"
#include "mapper/parallel.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// Right sides that are solved for at a time: each takes as much memory as all unknowns.
constexpr Eigen::Index kColumnsAtOnce = 64;

// Adds the rows of a segment's boundary to those of its unknowns.
template <typename Reduced>
void AddBoundary(const GraphSegment& segment, const Eigen::MatrixXd& boundary, Reduced* reduced) {
  for (std::size_t row = 0; row < segment.boundary.size(); ++row) {
    const int unknown = segment.boundary[row];
    if (unknown >= 0) reduced->row(unknown) += boundary.row(static_cast<Eigen::Index>(row));
  }
}

}  // namespace

std::unique_ptr<SchurPosterior> SchurPosterior::Of(
    const Graph& graph,
    const std::vector<std::vector<ModeIndex>>& required_sets,
    std::unique_ptr<ReducedSystem>* reduced) {
  SchurSystem system(graph, std::move(*reduced), required_sets);
  if (!system.Linearize(LossWeighting::kCurvature)) return nullptr;
  std::shared_ptr<const CholeskyFactor> factor = system.Factorize();
  if (!factor) return nullptr;
  *reduced = system.TakeReduced();
  return std::unique_ptr<SchurPosterior>(
      new SchurPosterior(graph, std::move(system), std::move(factor)));
}

// Jᵀ ε of one segment, a column of the right sides for each of several ε.
class SchurPosterior::Gradients {
 public:
  Gradients(const GraphSegment& segment, PoseRows* poses, Eigen::MatrixXd* boundary)
      : segment_(segment), poses_(*poses), boundary_(*boundary) {}

  void AddMotion(Eigen::Index column,
                 FrameIndex frame,
                 const MotionResidual::Linear& linear,
                 const Eigen::Vector3d& noise) {
    AddPose(column, frame, linear.J_i.transpose() * noise);
    AddPose(column, frame + 1, linear.J_j.transpose() * noise);
    boundary_.block<4, 1>(kCorrectionColumn, column) += linear.J_calibration.transpose() * noise;
  }

  // @param noise  A column each, from `column` on.
  template <typename Noise>
  void AddObservation(Eigen::Index column,
                      FrameIndex frame,
                      int mode_column,
                      const ObservationResidual::Linear& linear,
                      const Noise& noise) {
    constexpr int kColumns = Noise::ColsAtCompileTime;
    const Eigen::Index columns = noise.cols();
    AddPose(column, frame, linear.J_pose.transpose() * noise);
    boundary_.block<3, kColumns>(kBiasColumn, column, 3, columns) +=
        linear.J_bias.transpose() * noise;
    boundary_.block<2, kColumns>(mode_column, column, 2, columns) +=
        linear.J_landmark.transpose() * noise;
  }

 private:
  template <typename Gradient>
  void AddPose(Eigen::Index column, FrameIndex frame, const Gradient& gradient) {
    constexpr int kColumns = Gradient::ColsAtCompileTime;
    const Eigen::Index columns = gradient.cols();
    const SegmentVariable at = PoseVariable(segment_, frame);
    if (at.pose >= 0) {
      poses_.block<3, kColumns>(Eigen::Index{3} * at.pose, column, 3, columns) += gradient;
    } else {
      boundary_.block<3, kColumns>(at.column, column, 3, columns) += gradient;
    }
  }

  const GraphSegment& segment_;
  PoseRows& poses_;
  Eigen::MatrixXd& boundary_;
};

// H⁻¹ Jᵀ ε of separators, calibrations and modes.
// @param reduced  Jᵀ ε of the priors, a column each.
// @param inside   Per segment what its poses follow from, given the boundary.
Eigen::MatrixXd SchurPosterior::SolveNoise(const AddNoise& add_noise,
                                           Eigen::MatrixXd reduced,
                                           std::vector<PoseRows>* inside) const {
  const std::vector<GraphSegment>& segments = system_.segments().all();
  inside->resize(segments.size());
  std::vector<Eigen::MatrixXd> boundaries(segments.size());
  ForEachIndex(segments.size(), graph_.threads, [&](std::size_t i) {
    const GraphSegment& segment = segments[i];
    PoseRows& poses = (*inside)[i];
    poses.setZero(Eigen::Index{3} * segment.poses(), reduced.cols());
    boundaries[i].setZero(std::ssize(segment.boundary), reduced.cols());
    Gradients gradients(segment, &poses, &boundaries[i]);
    add_noise(segment, &gradients);
    system_.factor(i).Eliminate(&poses, &boundaries[i]);
  });
  for (std::size_t i = 0; i < segments.size(); ++i) {
    AddBoundary(segments[i], boundaries[i], &reduced);
  }
  return factor_->Solve(reduced);
}

std::vector<ResidualSample> SchurPosterior::SampleResiduals(int count,
                                                            std::mt19937_64& random) const {
  RandomSigns signs(&random);
  std::vector<ResidualSample> samples(static_cast<std::size_t>(count));
  for (ResidualSample& sample : samples) {
    for (const GraphRun& run : graph_.runs) {
      signs.Fill(std::ssize(run.motions), &sample.noise.motions.emplace_back());
    }
    signs.Fill(std::ssize(graph_.observations), &sample.noise.observations);
  }
  const auto add_noise = [&](const GraphSegment& segment, Gradients* gradients) {
    system_.linearizer().Visit(
        segment,
        LossWeighting::kCurvature,
        [&](FrameIndex frame, const MotionResidual::Linear& linear) {
          for (Eigen::Index k = 0; k < count; ++k) {
            const GraphResiduals& of_sample = samples[static_cast<std::size_t>(k)].noise;
            gradients->AddMotion(
                k, frame, linear, of_sample.motions[segment.run].col(frame.value()));
          }
        },
        [&](std::size_t i, double root, const ObservationResidual::Linear& linear) {
          const ObservationIndex index = segment.observations[i];
          const FrameIndex frame = graph_.observations[index].frame;
          for (Eigen::Index k = 0; k < count; ++k) {
            const GraphResiduals& of_sample = samples[static_cast<std::size_t>(k)].noise;
            gradients->AddObservation(
                k,
                frame,
                segment.mode_columns[i],
                linear,
                Eigen::Vector2d(root * of_sample.observations.col(index.value())));
          }
        });
  };
  std::vector<PoseRows> inside;
  const Eigen::MatrixXd reduced = SolveNoise(add_noise, PriorNoise(count, random), &inside);
  for (Eigen::Index k = 0; k < count; ++k) {
    samples[static_cast<std::size_t>(k)].step =
        system_.Complete(reduced.col(k), [&](std::size_t i, const Eigen::VectorXd& boundary) {
          return system_.factor(i).BackSubstitute(inside[i].col(k), boundary);
        });
  }
  return samples;
}

// ε - J x of each sample.
std::vector<GraphResiduals> SchurPosterior::DrawFitResiduals(int count,
                                                             std::mt19937_64& random) const {
  const std::vector<ResidualSample> samples = SampleResiduals(count, random);
  std::vector<GraphResiduals> left;
  for (const ResidualSample& sample : samples) left.push_back(sample.noise);
  for (const GraphSegment& segment : system_.segments().all()) {
    const RunIndex r = segment.run;
    const auto pose = [&](const GraphStep& step, FrameIndex frame) {
      return step.poses[r].segment<3>(3 * frame);
    };
    system_.linearizer().Visit(
        segment,
        LossWeighting::kCurvature,
        [&](FrameIndex frame, const MotionResidual::Linear& linear) {
          for (std::size_t k = 0; k < samples.size(); ++k) {
            const GraphStep& step = samples[k].step;
            left[k].motions[r].col(frame.value()) -=
                linear.J_i * pose(step, frame) + linear.J_j * pose(step, frame + 1) +
                linear.J_calibration * step.calibrations[r].head<4>();
          }
        },
        [&](std::size_t i, double root, const ObservationResidual::Linear& linear) {
          const ObservationIndex index = segment.observations[i];
          const GraphObservation& item = graph_.observations[index];
          for (std::size_t k = 0; k < samples.size(); ++k) {
            const GraphStep& step = samples[k].step;
            left[k].observations.col(index.value()) -=
                root * (linear.J_pose * pose(step, item.frame) +
                        linear.J_bias * step.calibrations[r].tail<3>() +
                        linear.J_landmark * step.modes.segment<2>(2 * item.mode));
          }
        });
  }
  return left;
}

// Eᵀ E less what each elimination takes: that of a segment's poses, then that of the rest.
GraphPosterior::ErrorFit SchurPosterior::FitErrors(const LinearErrors& errors) const {
  struct Eliminated {
    Eigen::MatrixXd information;
    Eigen::MatrixXd boundary;
  };
  const std::vector<GraphSegment>& segments = system_.segments().all();
  std::vector<Eliminated> eliminated(segments.size());
  ForEachIndex(segments.size(), graph_.threads, [&](std::size_t s) {
    const GraphSegment& segment = segments[s];
    const Eigen::Index columns = std::ssize(errors.of_run[segment.run]);
    Eliminated& result = eliminated[s];
    result.information.setZero(columns, columns);
    result.boundary.setZero(std::ssize(segment.boundary), columns);
    PoseRows poses = Eigen::MatrixXd::Zero(Eigen::Index{3} * segment.poses(), columns);
    Gradients gradients(segment, &poses, &result.boundary);
    system_.linearizer().VisitObservations(
        segment,
        LossWeighting::kCurvature,
        [&](std::size_t i, double root, const ObservationResidual::Linear& linear) {
          const ObservationIndex index = segment.observations[i];
          const Eigen::Matrix2Xd E = errors.of_observation(index);
          result.information.noalias() += E.transpose() * E;
          gradients.AddObservation(0,
                                   graph_.observations[index].frame,
                                   segment.mode_columns[i],
                                   linear,
                                   Eigen::Matrix2Xd(root * E));
        });
    system_.factor(s).Eliminate(&poses, &result.boundary);
    result.information.noalias() -= poses.transpose() * poses;
  });
  Eigen::MatrixXd reduced = Eigen::MatrixXd::Zero(factor_->size(), errors.amplitudes);
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(errors.amplitudes, errors.amplitudes);
  for (std::size_t s = 0; s < segments.size(); ++s) {
    const std::vector<Eigen::Index>& columns = errors.of_run[segments[s].run];
    information(columns, columns) += eliminated[s].information;
    auto of_run = reduced(Eigen::all, columns);
    AddBoundary(segments[s], eliminated[s].boundary, &of_run);
  }
  Eigen::MatrixXd mode_steps(ModeRows(), errors.amplitudes);
  for (Eigen::Index column = 0; column < errors.amplitudes; column += kColumnsAtOnce) {
    const Eigen::Index columns = std::min(kColumnsAtOnce, errors.amplitudes - column);
    const Eigen::MatrixXd steps = factor_->Solve(reduced.middleCols(column, columns));
    information.middleCols(column, columns).noalias() -= reduced.transpose() * steps;
    mode_steps.middleCols(column, columns) = steps.bottomRows(ModeRows());
  }
  return {Symmetrized(information), std::move(mode_steps)};
}

Eigen::MatrixXd SchurPosterior::ModeStepsByBlock(const GraphResiduals& residuals,
                                                 const FrameBlocks& block_of_frame,
                                                 int blocks) const {
  const auto add_noise = [&](const GraphSegment& segment, Gradients* gradients) {
    const RunIndex r = segment.run;
    const auto block = [&](FrameIndex frame) { return block_of_frame[r][frame]; };
    system_.linearizer().Visit(
        segment,
        LossWeighting::kCurvature,
        [&](FrameIndex frame, const MotionResidual::Linear& linear) {
          gradients->AddMotion(
              block(frame), frame, linear, residuals.motions[r].col(frame.value()));
        },
        [&](std::size_t i, double root, const ObservationResidual::Linear& linear) {
          const ObservationIndex index = segment.observations[i];
          const FrameIndex frame = graph_.observations[index].frame;
          gradients->AddObservation(
              block(frame),
              frame,
              segment.mode_columns[i],
              linear,
              Eigen::Vector2d(root * residuals.observations.col(index.value())));
        });
  };
  std::vector<PoseRows> inside;
  return SolveNoise(add_noise, Eigen::MatrixXd::Zero(factor_->size(), blocks), &inside)
      .bottomRows(ModeRows());
}

// Jᵀ ε of the priors, a column a sample, over the reduced system.
Eigen::MatrixXd SchurPosterior::PriorNoise(int count, std::mt19937_64& random) const {
  RandomSigns signs(&random);
  Eigen::MatrixXd right = Eigen::MatrixXd::Zero(factor_->size(), count);
  for (const RunIndex r : graph_.runs.indices()) {
    const GraphRun& run = graph_.runs[r];
    Eigen::Matrix<double, kRunCalibration, Eigen::Dynamic> noise;
    signs.Fill(count, &noise);
    const Eigen::Index row = system_.segments().first_calibration() + kRunCalibration * r;
    right.middleRows<3>(row) =
        run.correction_prior_sd.cwiseInverse().asDiagonal() * noise.topRows<3>();
    right.middleRows<3>(row + 3) =
        run.sensor_bias_sd.cwiseInverse().asDiagonal() * noise.bottomRows<3>();
  }
  for (const GraphPrior& prior : graph_.priors) {
    Eigen::MatrixXd noise(prior.sqrt_information.rows(), count);
    signs.Fill(count, &noise);
    right(system_.segments().UnknownsOf(prior.modes), Eigen::all) +=
        prior.sqrt_information.transpose() * noise;
  }
  return right;
}

// The inverse of the calibrations' block of H⁻¹.
Eigen::MatrixXd SchurPosterior::CalibrationInformationTimes(const Eigen::MatrixXd& weights) const {
  return factor_
      ->CovarianceBlock(system_.segments().first_calibration(), static_cast<int>(weights.rows()))
      .llt()
      .solve(weights);
}

Eigen::MatrixXd SchurPosterior::ModeCovariance() const {
  return factor_->CovarianceBlock(system_.segments().first_mode(), ModeRows());
}

Eigen::MatrixXd SchurPosterior::ModeCovarianceTimes(const Eigen::MatrixXd& weights) const {
  Eigen::MatrixXd right = Eigen::MatrixXd::Zero(factor_->size(), weights.cols());
  right.bottomRows(weights.rows()) = weights;
  return factor_->Solve(right).bottomRows(weights.rows());
}

Eigen::Matrix2d SchurPosterior::ModeDifferenceCovariance(ModeIndex a, ModeIndex b) const {
  Eigen::Matrix<double, 4, 2> difference;
  difference << Eigen::Matrix2d::Identity(), -Eigen::Matrix2d::Identity();
  return factor_->QuadraticForm(system_.segments().UnknownsOf({a, b}), difference);
}

Eigen::MatrixXd SchurPosterior::DrawModes(int draws, std::mt19937_64& random) const {
  std::normal_distribution<double> normal;
  Eigen::MatrixXd z(factor_->size(), draws);
  for (double& value : z.reshaped()) value = normal(random);
  return factor_->SolveUpper(z).bottomRows(ModeRows());
}

void SchurPosterior::VisitModeCovariance(const BlockVisitor& visitor) const {
  const int first_mode = system_.segments().first_mode();
  std::vector<std::pair<Eigen::Index, ModeIndex>> modes;  // Row in the block, mode.
  factor_->VisitInverse(
      [&](const std::vector<int>& unknowns, int own, const Eigen::MatrixXd& block) {
        modes.clear();
        for (std::size_t i = 0; i < unknowns.size(); ++i) {
          const int offset = unknowns[i] - first_mode;
          if (offset < 0 || offset % 2 != 0) continue;
          modes.emplace_back(static_cast<Eigen::Index>(i), ModeIndex(offset / 2));
        }
        for (std::size_t a = 0; a < modes.size() && modes[a].first < own; ++a) {
          const auto [row, mode] = modes[a];
          const Eigen::Matrix2d marginal = block.block<2, 2>(row, row);
          visitor(mode, mode, Symmetrized(marginal));
          for (std::size_t b = a + 1; b < modes.size(); ++b) {
            visitor(mode, modes[b].second, block.block<2, 2>(row, modes[b].first));
          }
        }
      });
}

}  // namespace shiftmap
