// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/alignment_evidence.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <numbers>
#include <unsupported/Eigen/SpecialFunctions>
#include <utility>

#include "localizer/hypothesis/log_math.h"
#include "mapper/rows.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/geometry/se2.h"

namespace shiftmap {
namespace {

const double kLog2Pi = std::log(2.0 * std::numbers::pi);

Eigen::Matrix2d RotationBy(double yaw_rad) { return Se2(0.0, 0.0, yaw_rad).Rotation(); }

}  // namespace

double LogGamma(double x) { return Eigen::numext::lgamma(x); }

double LogChoose(double n, double k) {
  return LogGamma(n + 1.0) - LogGamma(k + 1.0) - LogGamma(n - k + 1.0);
}

Eigen::Vector2d SimilarityFit::operator*(const Eigen::Vector2d& p_reference) const {
  return centre_other +
         std::exp(log_scale) * (RotationBy(yaw_rad) * (p_reference - centre_reference));
}

AlignmentEvidence::AlignmentEvidence(const JointPoints& reference,
                                     const JointPoints& other,
                                     double area_m2,
                                     const MovePrior& prior)
    : reference_(reference),
      other_(other),
      prior_(prior),
      log_area_(std::log(area_m2)),
      log_anywhere_(std::log1p(-prior.near_share) - log_area_),
      matches_(CandidateMatches(reference.points, other.points)) {
  for (const MatchIndex k : matches_.indices()) {
    if (groups_.empty() || matches_[k].other != matches_[k - 1].other) {
      groups_.push_back(matches_[k].group);
      of_landmark_.push_back({k, k});
    }
    landmarks_.push_back(groups_.end_index() - 1);
    of_landmark_.back().last = k + 1;
  }
  if (matches_.size() > kMaxMatches) return;
  for (const Match& match : matches_) {
    MatchSet rivals;
    for (const MatchIndex k : matches_.indices()) {
      const Match& other_match = matches_[k];
      if (other_match.other == match.other || other_match.reference == match.reference) {
        rivals = rivals.Flipped(k);
      }
    }
    rivals_.push_back(rivals);
  }
}

double AlignmentEvidence::LogModes(MatchIndex match) const {
  const auto [first, last] = MatchesOf(LandmarkOf(match));
  return std::log(1.0 * (last - first));
}

double AlignmentEvidence::Variance(MatchIndex match) const {
  const Eigen::Index reference = RowOf(matches_[match].reference);
  const Eigen::Index other = RowOf(matches_[match].other);
  return 0.5 * (reference_.covariance.block<2, 2>(reference, reference).trace() +
                other_.covariance.block<2, 2>(other, other).trace());
}

double AlignmentEvidence::LogStaying(int stayed) const {
  const auto count = static_cast<double>(groups_.size());
  return std::log1p(-prior_.none_stayed) - std::log(count - 1.0) - LogChoose(count, stayed);
}

double AlignmentEvidence::LogMovedBy(const Eigen::Vector2d& r, const Eigen::Matrix2d& cov_r) const {
  const double log_size =
      std::log(prior_.near_share / static_cast<double>(prior_.near_sd_m.size()));
  const double variance = 0.5 * cov_r.trace();
  double log_density = log_anywhere_;
  for (const double sd : prior_.near_sd_m) {
    // E|u|² / 2s² of the move given r, with which the Gaussian is weighted.
    const double s2 = sd * sd;
    const double gain = s2 / (s2 + variance);
    const double ring = (gain * gain * r.squaredNorm() + 2.0 * gain * variance) / (2.0 * s2);
    log_density = LogAdd(
        log_density,
        log_size + std::log(ring) + LogGaussian(r, cov_r + s2 * Eigen::Matrix2d::Identity()));
  }
  return log_density;
}

// One set: the fit of the transform to what stayed, and what that predicts of the others.
class SetEvaluation {
 public:
  SetEvaluation(const AlignmentEvidence& evidence, const MatchSet& stayed)
      : e_(evidence), stayed_(stayed), in_(stayed.Members()) {
    IndexedVector<LandmarkIndex, bool> has_stayed(e_.groups_.size());
    for (const MatchIndex k : in_) has_stayed[e_.LandmarkOf(k)] = true;
    for (const LandmarkIndex l : has_stayed.indices()) {
      if (!has_stayed[l]) moved_.push_back(l);
    }
    Start();
    Fit();
  }

  SetScore Score(IndexedVector<MatchIndex, double>* gains) {
    const auto stayed = static_cast<int>(in_.size());
    SetScore score;
    score.fit = fit_;
    score.log_evidence = LogEvidence();
    score.log_moved.assign(e_.groups_.size(), 0.0);
    score.log_score = score.log_evidence + e_.LogStaying(stayed);
    for (const MatchIndex k : in_) score.log_score -= e_.LogModes(k);
    if (gains != nullptr) gains->assign(e_.matches_.size(), kLogZero);
    const double up = e_.LogStaying(stayed + 1) - e_.LogStaying(stayed);
    residual_ -= jacobian_ * step_;
    const Eigen::VectorXd whitened = llt_.solve(residual_);
    for (const LandmarkIndex landmark : moved_) {
      double log_moved = kLogZero;
      for (const MatchIndex k : e_.MatchesOf(landmark)) {
        const auto [r, cov] = Predict(k, whitened);
        log_moved = LogAdd(log_moved, e_.LogMovedBy(r, cov) - e_.LogModes(k));
        if (gains != nullptr && !stayed_.Intersects(e_.Rivals(k))) {
          (*gains)[k] = LogGaussian(r, cov);
        }
      }
      if (gains != nullptr) {
        for (const MatchIndex k : e_.MatchesOf(landmark)) {
          (*gains)[k] += up - log_moved - e_.LogModes(k);
        }
      }
      score.log_moved[landmark] = log_moved;
      score.log_score += log_moved;
    }
    if (gains != nullptr && stayed > 2) AddRemovals(gains);
    if (!std::isfinite(score.log_score)) score.log_score = kLogZero;
    return score;
  }

 private:
  const Match& At(MatchIndex match) const { return e_.matches_[match]; }

  // Least squares, all matches alike.
  void Start() {
    const auto count = static_cast<double>(in_.size());
    for (const MatchIndex k : in_) {
      fit_.centre_reference += e_.PositionInReference(k) / count;
      fit_.centre_other += e_.PositionInOther(k) / count;
    }
    double dot = 0.0;
    double cross = 0.0;
    for (const MatchIndex k : in_) {
      const Eigen::Vector2d a = e_.PositionInReference(k) - fit_.centre_reference;
      const Eigen::Vector2d b = e_.PositionInOther(k) - fit_.centre_other;
      dot += a.dot(b);
      cross += a.x() * b.y() - a.y() * b.x();
    }
    fit_.yaw_rad = std::atan2(cross, dot);
  }

  // Covariance of the differences of two matches. [m²]
  Eigen::Matrix2d Block(MatchIndex j, MatchIndex k) const {
    return e_.other_.covariance.block<2, 2>(RowOf(At(j).other), RowOf(At(k).other)) +
           R_ *
               e_.reference_.covariance.block<2, 2>(RowOf(At(j).reference),
                                                    RowOf(At(k).reference)) *
               R_.transpose();
  }

  // fit_ * p - fit_.centre_other.
  Eigen::Vector2d FromCentre(MatchIndex k) const {
    return scaled_R_ * (e_.PositionInReference(k) - fit_.centre_reference);
  }

  Eigen::Vector2d Residual(MatchIndex k) const {
    return e_.PositionInOther(k) - fit_.centre_other - FromCentre(k);
  }

  // d (fit * p) / d (centre_other, yaw, log scale).
  Eigen::Matrix<double, 2, 4> Jacobian(MatchIndex k) const {
    const Eigen::Vector2d q = FromCentre(k);
    Eigen::Matrix<double, 2, 4> jacobian;
    jacobian << 1.0, 0.0, -q.y(), q.x(), 0.0, 1.0, q.x(), q.y();
    return jacobian;
  }

  // Gauss-Newton; two steps and the linearization where they end.
  void Fit() {
    constexpr int kSteps = 2;
    const Eigen::Index rows = RowOf(in_.size());
    Eigen::MatrixXd covariance(rows, rows);
    residual_.resize(rows);
    jacobian_.resize(rows, 4);
    const double scale_information = 1.0 / (e_.prior_.sd_scale * e_.prior_.sd_scale);
    for (int i = 0; i <= kSteps; ++i) {
      R_ = RotationBy(fit_.yaw_rad);
      scaled_R_ = std::exp(fit_.log_scale) * R_;
      for (std::size_t p = 0; p < in_.size(); ++p) {
        for (std::size_t q = 0; q < in_.size(); ++q) {
          covariance.block<2, 2>(RowOf(p), RowOf(q)) = Block(in_[p], in_[q]);
        }
        residual_.segment<2>(RowOf(p)) = Residual(in_[p]);
        jacobian_.middleRows<2>(RowOf(p)) = Jacobian(in_[p]);
      }
      llt_.compute(covariance);
      weighted_jacobian_ = llt_.solve(jacobian_);
      Eigen::Matrix4d information = jacobian_.transpose() * weighted_jacobian_;
      information(3, 3) += scale_information;
      gradient_ = weighted_jacobian_.transpose() * residual_;
      gradient_[3] -= scale_information * fit_.log_scale;
      fit_.covariance = information.inverse();
      step_ = fit_.covariance * gradient_;
      if (i == kSteps) break;
      fit_.centre_other += step_.head<2>();
      fit_.yaw_rad += step_[2];
      fit_.log_scale += step_[3];
    }
  }

  // Gaussian integral over the transform: uniform over the area and all headings, normal in the log
  // of the scale.
  double LogEvidence() const {
    const double scale = fit_.log_scale / e_.prior_.sd_scale;
    const double chi2 = residual_.dot(llt_.solve(residual_)) + scale * scale - gradient_.dot(step_);
    const double log_det = 2.0 * llt_.matrixLLT().diagonal().array().log().sum();
    const auto count = static_cast<double>(in_.size());
    const double log_prior = -e_.log_area_ - kLog2Pi - std::log(e_.prior_.sd_scale) - 0.5 * kLog2Pi;
    return -0.5 * chi2 - 0.5 * log_det - count * kLog2Pi + log_prior + 2.0 * kLog2Pi +
           0.5 * std::log(fit_.covariance.determinant());
  }

  // The difference of a match that is not in the set from what that predicts, and its covariance.
  std::pair<Eigen::Vector2d, Eigen::Matrix2d> Predict(MatchIndex k,
                                                      const Eigen::VectorXd& whitened) const {
    Eigen::MatrixXd cross(2, RowOf(in_.size()));
    for (std::size_t p = 0; p < in_.size(); ++p) {
      cross.middleCols<2>(RowOf(p)) = Block(k, in_[p]);
    }
    const Eigen::MatrixXd gain = llt_.solve(cross.transpose());
    const Eigen::Matrix<double, 2, 4> jacobian = Jacobian(k);
    const Eigen::Matrix<double, 2, 4> remaining = jacobian - gain.transpose() * jacobian_;
    return {Residual(k) - jacobian * step_ - cross * whitened,
            Block(k, k) - cross * gain + remaining * fit_.covariance * remaining.transpose()};
  }

  // What taking one out gains: its difference from what the others predict, by the inverse of the
  // joint covariance once the transform is integrated out.
  void AddRemovals(IndexedVector<MatchIndex, double>* gains) const {
    const Eigen::Index rows = RowOf(in_.size());
    const Eigen::MatrixXd precision =
        llt_.solve(Eigen::MatrixXd::Identity(rows, rows)) -
        weighted_jacobian_ * fit_.covariance * weighted_jacobian_.transpose();
    const Eigen::VectorXd whitened = llt_.solve(residual_);
    const auto stayed = static_cast<int>(in_.size());
    const double down = e_.LogStaying(stayed - 1) - e_.LogStaying(stayed);
    for (std::size_t p = 0; p < in_.size(); ++p) {
      const Eigen::Matrix2d information = precision.block<2, 2>(RowOf(p), RowOf(p));
      if (!(information.determinant() > 0.0)) continue;
      const Eigen::Matrix2d cov = information.inverse();
      const Eigen::Vector2d r = cov * whitened.segment<2>(RowOf(p));
      (*gains)[in_[p]] = e_.LogMovedBy(r, cov) - LogGaussian(r, cov) + down + e_.LogModes(in_[p]);
    }
  }

  const AlignmentEvidence& e_;
  MatchSet stayed_;
  std::vector<MatchIndex> in_;        // In the set.
  std::vector<LandmarkIndex> moved_;  // Without a match in it.
  SimilarityFit fit_;
  Eigen::Matrix2d R_;                // Of fit_,
  Eigen::Matrix2d scaled_R_;         // and with its scale.
  Eigen::LLT<Eigen::MatrixXd> llt_;  // Of the joint covariance of the differences.
  Eigen::VectorXd residual_;         // At fit_, and in the end less the last step.
  Eigen::MatrixXd jacobian_;
  Eigen::MatrixXd weighted_jacobian_;
  Eigen::Vector4d gradient_;
  Eigen::Vector4d step_;  // The last one, too small to take.
};

SetScore AlignmentEvidence::Score(const MatchSet& stayed,
                                  IndexedVector<MatchIndex, double>* gains) const {
  return SetEvaluation(*this, stayed).Score(gains);
}

}  // namespace shiftmap
