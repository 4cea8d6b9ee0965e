// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/all_moved.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <numbers>
#include <random>

#include "localizer/hypothesis/log_math.h"

namespace shiftmap {
namespace {

// log(eᵃ - eᵇ), a >= b but for rounding.
double LogDifference(double a, double b) {
  return b < a ? a + std::log1p(-std::exp(b - a)) : kLogZero;
}

// A Gaussian over rigid transforms: (centre_other, yaw_rad) of `fit`.
struct Proposal {
  SimilarityFit fit;
  Eigen::LLT<Eigen::Matrix3d> information;

  double LogDensity(const SimilarityFit& x) const {
    Eigen::Vector3d offset;
    offset << x * fit.centre_reference - fit.centre_other,
        std::remainder(x.yaw_rad - fit.yaw_rad, kTwoPi);
    const Eigen::Vector3d z = information.matrixU() * offset;
    return -0.5 * z.squaredNorm() - 1.5 * std::log(kTwoPi) +
           information.matrixLLT().diagonal().array().log().sum();
  }
};

class AllMoved {
 public:
  explicit AllMoved(const AlignmentEvidence& evidence) : e_(evidence) {}

  double LogDensity(const std::vector<SimilarityFit>& starts) const {
    constexpr int kDraws = 64;  // Of each.
    std::vector<Proposal> proposals;
    for (const SimilarityFit& start : starts) proposals.push_back(AroundLeastMoves(start));
    std::mt19937_64 random(1);
    std::normal_distribution<double> normal;
    double total = kLogZero;
    for (const Proposal& proposal : proposals) {
      for (int i = 0; i < kDraws; ++i) {
        const Eigen::Vector3d z(normal(random), normal(random), normal(random));
        const Eigen::Vector3d step = proposal.information.matrixU().solve(z);
        // Densities are of turns to the nearer side.
        if (std::abs(step[2]) > std::numbers::pi) continue;
        SimilarityFit x = proposal.fit;
        x.centre_other += step.head<2>();
        x.yaw_rad += step[2];
        double log_proposal = kLogZero;
        for (const Proposal& other : proposals) {
          log_proposal = LogAdd(log_proposal, other.LogDensity(x));
        }
        total = LogAdd(total, LogSomeNear(x) - log_proposal);
      }
    }
    // Each has as many draws: of their mixture.
    return total - std::log(static_cast<double>(kDraws)) - e_.log_area() - std::log(kTwoPi);
  }

 private:
  double LogSomeNear(const SimilarityFit& x) const {
    double log_density = 0.0;
    for (const LandmarkIndex l : e_.groups().indices()) log_density += LogMoved(l, x);
    return LogDifference(log_density, e_.LogAllAnywhere());
  }

  // Expectation and maximization over how far each landmark moved, from a start; the Gaussian there
  // is widened to reach what lies around.
  Proposal AroundLeastMoves(SimilarityFit fit) const {
    constexpr int kIterations = 12;  // It is a proposal: draws are weighed.
    constexpr double kWider = 2.0;   // In standard deviations.
    fit.log_scale = 0.0;
    // Beyond the area and a turn nothing is near.
    const double per_area = std::exp(-e_.log_area());
    Eigen::Matrix3d information;
    for (int i = 0; i < kIterations; ++i) {
      information = Eigen::Vector3d(per_area, per_area, 1.0).asDiagonal();
      Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
      for (const LandmarkIndex l : e_.groups().indices()) {
        AddNear(l, fit, &information, &gradient);
      }
      const Eigen::Vector3d step = information.llt().solve(gradient);
      fit.centre_other += step.head<2>();
      fit.yaw_rad += step[2];
    }
    return {fit, Eigen::LLT<Eigen::Matrix3d>(information / (kWider * kWider))};
  }

  // log density of a landmark that moved near or anywhere, from any of its modes.
  double LogMoved(LandmarkIndex landmark, const SimilarityFit& fit) const {
    double log_density = kLogZero;
    for (const MatchIndex k : e_.MatchesOf(landmark)) {
      const Eigen::Vector2d r = e_.PositionInOther(k) - fit * e_.PositionInReference(k);
      log_density =
          LogAdd(log_density, e_.LogMovedBy(r, e_.Variance(k) * Eigen::Matrix2d::Identity()));
    }
    return log_density - e_.LogModes(e_.MatchesOf(landmark).first);
  }

  // The same with Gaussian densities of near moves, which have one maximum.
  void AddNear(LandmarkIndex landmark,
               const SimilarityFit& fit,
               Eigen::Matrix3d* information,
               Eigen::Vector3d* gradient) const {
    const IndexRange<MatchIndex> matches = e_.MatchesOf(landmark);
    const int modes = matches.last - matches.first;
    const MovePrior& prior = e_.prior();
    const double log_each =
        std::log(prior.near_share / static_cast<double>(prior.near_sd_m.size()) / modes);
    double total = e_.log_anywhere();
    const auto visit_all = [&](const auto& visit) {
      for (const MatchIndex k : matches) {
        const Eigen::Vector2d q = fit * e_.PositionInReference(k) - fit.centre_other;
        const Eigen::Vector2d r = e_.PositionInOther(k) - fit.centre_other - q;
        for (const double sd : prior.near_sd_m) {
          const double variance = sd * sd + e_.Variance(k);
          visit(q,
                r,
                variance,
                log_each - 0.5 * r.squaredNorm() / variance - std::log(kTwoPi * variance));
        }
      }
    };
    visit_all([&](const auto&, const auto&, double, double log_density) {
      total = LogAdd(total, log_density);
    });
    visit_all([&](const Eigen::Vector2d& q,
                  const Eigen::Vector2d& r,
                  double variance,
                  double log_density) {
      const double weight = std::exp(log_density - total) / variance;
      Eigen::Matrix<double, 2, 3> jacobian;
      jacobian << 1.0, 0.0, -q.y(), 0.0, 1.0, q.x();
      *information += weight * jacobian.transpose() * jacobian;
      *gradient += weight * jacobian.transpose() * r;
    });
  }

  const AlignmentEvidence& e_;
};

}  // namespace

double LogAllMovedSomeNear(const AlignmentEvidence& evidence,
                           const std::vector<SimilarityFit>& starts) {
  return AllMoved(evidence).LogDensity(starts);
}

}  // namespace shiftmap
