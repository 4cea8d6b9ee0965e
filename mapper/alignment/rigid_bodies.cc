// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/rigid_bodies.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

#include "localizer/hypothesis/log_math.h"

namespace shiftmap {
namespace {

// Landmarks of one body, and bodies of one site, that are looked for by where they stand.
constexpr std::size_t kMaxSize = 16;
constexpr std::size_t kMaxClusters = 8;

// What is less probable before anything is known of moves is no cluster. Nor is what reaches
// farther than this many of the largest MovePrior::body_sd_m.
constexpr double kMinWeight = 0.02;
constexpr double kReach = 3.0;

// A polynomial in the probability p that something stayed: the sum of c pᵃ (1 - p)ᵇ.
class StayingPolynomial {
 public:
  StayingPolynomial(int stayed, int moved) { terms_[{stayed, moved}] = 1.0; }

  struct Term {
    double weight = 0.0;
    int stayed = 0;
    int moved = 0;
  };

  void MultiplyBy(const std::vector<Term>& factor) {
    std::map<std::pair<int, int>, double> product;
    for (const auto& [exponents, weight] : terms_) {
      for (const Term& term : factor) {
        product[{exponents.first + term.stayed, exponents.second + term.moved}] +=
            weight * term.weight;
      }
    }
    terms_ = std::move(product);
  }

  // log of its integral over p from 0 to 1.
  double LogIntegral() const {
    double total = kLogZero;
    for (const auto& [exponents, weight] : terms_) {
      if (!(weight > 0.0)) continue;
      const auto [a, b] = exponents;
      total = LogAdd(
          total, std::log(weight) + LogGamma(a + 1.0) + LogGamma(b + 1.0) - LogGamma(a + b + 2.0));
    }
    return total;
  }

 private:
  std::map<std::pair<int, int>, double> terms_;
};

}  // namespace

RigidBodies::RigidBodies(const AlignmentEvidence& evidence)
    : e_(evidence),
      prior_(evidence.prior()),
      landmarks_(static_cast<int>(evidence.groups().size())) {
  if (prior_.group_share > 0.0) FindClusters();
  for (const MatchSet& cluster : clusters_) log_probabilities_.push_back(LogProbability(cluster));
}

// log density of where a body stands, if it stands close together, against as many landmarks
// anywhere.
double RigidBodies::LogCompact(const std::vector<MatchIndex>& members) const {
  const auto count = static_cast<double>(members.size());
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const MatchIndex k : members) mean += e_.PositionInReference(k) / count;
  double squared = 0.0;
  for (const MatchIndex k : members) squared += (e_.PositionInReference(k) - mean).squaredNorm();
  double log_compact = kLogZero;
  for (const double sd : prior_.body_sd_m) {
    log_compact = LogAdd(
        log_compact,
        -(count - 1.0) * std::log(2.0 * std::numbers::pi * sd * sd) - 0.5 * squared / (sd * sd));
  }
  return log_compact + (count - 1.0) * e_.log_area() - std::log(count) -
         std::log(static_cast<double>(prior_.body_sd_m.size()));
}

double RigidBodies::LogWeight(const MatchSet& body) const {
  const std::vector<MatchIndex> members = body.Members();
  const auto count = static_cast<double>(members.size());
  double log_modes = 0.0;
  for (const MatchIndex k : members) log_modes += e_.LogModes(k);
  const double log_stands = LogAdd(std::log1p(-prior_.scattered_share) + LogCompact(members),
                                   std::log(prior_.scattered_share));
  return std::log(prior_.group_share) + (count - kMinSize) * std::log(prior_.group_continue) +
         std::log1p(-prior_.group_continue) - LogChoose(landmarks_, count) + log_stands - log_modes;
}

double RigidBodies::ScatteredShare(const MatchSet& body) const {
  const double scattered = prior_.scattered_share;
  return scattered / (scattered + (1.0 - scattered) * std::exp(LogCompact(body.Members())));
}

void RigidBodies::FindClusters() {
  MatchSet taken;
  while (clusters_.size() < kMaxClusters) {
    double log_weight = std::log(kMinWeight);
    MatchSet cluster;
    for (const MatchIndex centre : e_.matches().indices()) {
      if (taken.Contains(centre)) continue;
      MatchSet body;
      for (const MatchIndex k : NearestTo(centre, taken)) {
        if (body.Intersects(e_.Rivals(k))) continue;
        body = body.Flipped(k);
        if (body.Count() < kMinSize) continue;
        const double log_weight_of_body = LogWeight(body);
        if (log_weight_of_body <= log_weight) continue;
        log_weight = log_weight_of_body;
        cluster = body;
      }
    }
    if (cluster.empty()) return;
    clusters_.push_back(cluster);
    weights_.push_back(std::exp(log_weight));
    for (const MatchIndex k : cluster.Members()) taken = taken | e_.Rivals(k);
  }
}

std::vector<MatchIndex> RigidBodies::NearestTo(MatchIndex match, const MatchSet& taken) const {
  const double reach = kReach * *std::max_element(prior_.body_sd_m.begin(), prior_.body_sd_m.end());
  std::vector<std::pair<double, MatchIndex>> near;
  for (const MatchIndex k : e_.matches().indices()) {
    if (taken.Contains(k)) continue;
    const double squared =
        (e_.PositionInReference(k) - e_.PositionInReference(match)).squaredNorm();
    if (squared <= reach * reach) near.emplace_back(squared, k);
  }
  std::sort(near.begin(), near.end());
  if (near.size() > kMaxSize) near.resize(kMaxSize);
  std::vector<MatchIndex> nearest;
  for (const auto& [squared, k] : near) nearest.push_back(k);
  return nearest;
}

double RigidBodies::LogProbability(const MatchSet& body) const {
  const double log_weight = LogWeight(body);
  double others = 0.0;  // That it is part of, or has parts of.
  for (std::size_t c = 0; c < clusters_.size(); ++c) {
    if (clusters_[c].Intersects(body)) others += weights_[c];
  }
  return log_weight - std::log1p(std::max(others, std::exp(log_weight)));
}

double RigidBodies::LogStaying(const MatchSet& stayed, const std::vector<MatchSet>& moved) const {
  MatchSet in_moved;
  double log_prior = 0.0;
  int singly_moved = landmarks_ - stayed.Count();
  for (const MatchSet& body : moved) {
    in_moved = in_moved | body;
    log_prior += LogProbability(body) + std::log1p(-prior_.body_apart);
    singly_moved -= body.Count();
  }
  MatchSet present;  // Matches of landmarks that stayed.
  for (const MatchIndex k : stayed.Members()) present = present | e_.Rivals(k);
  int singly_stayed = stayed.Count();
  std::vector<std::vector<StayingPolynomial::Term>> factors;
  for (std::size_t c = 0; c < clusters_.size(); ++c) {
    const MatchSet& cluster = clusters_[c];
    if (cluster.Intersects(in_moved)) continue;
    const MatchSet there = cluster & stayed;
    const int stays = there.Count();
    const int leaves = cluster.Without(present).Count();
    if (stays + leaves < kMinSize) continue;
    const double together =
        stays < kMinSize ? 0.0 : (1.0 - prior_.body_apart) * std::exp(LogProbability(there));
    const double is_one = (1.0 - prior_.body_apart) * std::exp(log_probabilities_[c]);
    singly_stayed -= stays;
    singly_moved -= leaves;
    factors.push_back({{1.0 - std::max(together, is_one), stays, leaves}, {together, 1, leaves}});
  }
  StayingPolynomial polynomial(singly_stayed, singly_moved + static_cast<int>(moved.size()));
  for (const auto& factor : factors) polynomial.MultiplyBy(factor);
  // Fewer than two stay with another probability.
  return log_prior + polynomial.LogIntegral() + std::log1p(-prior_.none_stayed) +
         std::log((landmarks_ + 1.0) / (landmarks_ - 1.0));
}

double RigidBodies::LogAllMoved(const std::vector<MatchSet>& moved) const {
  double log_prior = 0.0;
  MatchSet in_moved;
  for (const MatchSet& body : moved) {
    in_moved = in_moved | body;
    log_prior += LogProbability(body) + std::log1p(-prior_.body_apart);
  }
  for (std::size_t c = 0; c < clusters_.size(); ++c) {
    if (clusters_[c].Intersects(in_moved)) continue;
    log_prior += std::log1p(-(1.0 - prior_.body_apart) * std::exp(log_probabilities_[c]));
  }
  return log_prior;
}

}  // namespace shiftmap
