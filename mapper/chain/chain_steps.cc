// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/chain_steps.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <utility>

#include "proto/core/check.h"

namespace shiftmap {
namespace {

// Cuts [begin, end) where a phase of the calendar ends.
std::vector<ChainSteps::Gap> CutGap(Stamp begin, Stamp end, const RhythmCalendar& calendar) {
  if (calendar.phases == 1) return {{end - begin, 0}};
  std::vector<ChainSteps::Gap> pieces;
  calendar.ForEachPart(begin, end - begin, [&](int phase, Duration length) {
    pieces.push_back({length, phase});
  });
  return pieces;
}

class Builder {
 public:
  Builder(ChainSteps* steps, double gap_resolution)
      : steps_(steps), log_resolution_(std::log1p(gap_resolution)) {}

  void Add(const ChainSteps::Gap& gap, const Eigen::VectorXd& likelihoods) {
    const auto [found, added] = index_.try_emplace({ClassOf(gap.length), gap.phase}, Lengths());
    if (added) {
      found->second.index = steps_->gaps.size();
      steps_->gaps.push_back(gap);
    }
    found->second.total_s += ToSeconds(gap.length);
    found->second.count += 1.0;
    steps_->gap_of_step.push_back(static_cast<int>(found->second.index));
    columns_.push_back(likelihoods);
  }

  void AddFirst(const Eigen::VectorXd& likelihoods) {
    steps_->gap_of_step.push_back(-1);
    columns_.push_back(likelihoods);
  }

  void Finish() {
    steps_->likelihoods.resize(steps_->states, static_cast<Eigen::Index>(columns_.size()));
    Eigen::Index column = 0;
    for (const Eigen::VectorXd& values : columns_) steps_->likelihoods.col(column++) = values;
    if (!(log_resolution_ > 0.0)) return;
    for (const auto& [key, lengths] : index_) {
      steps_->gaps[lengths.index].length = FromSeconds(lengths.total_s / lengths.count);
    }
  }

 private:
  // Gaps of one class.
  struct Lengths {
    std::size_t index = 0;  // In ChainSteps::gaps.
    double total_s = 0.0;
    double count = 0.0;
  };

  std::int64_t ClassOf(Duration length) const {
    if (!(log_resolution_ > 0.0) || length <= Duration(0)) return length.count();
    return std::llround(std::log(ToSeconds(length)) / log_resolution_);
  }

  ChainSteps* steps_;
  double log_resolution_;
  std::map<std::pair<std::int64_t, int>, Lengths> index_;
  std::vector<Eigen::VectorXd> columns_;
};

}  // namespace

ChainSteps MakeChainSteps(const ChainHistory& history,
                          const RhythmCalendar& calendar,
                          double gap_resolution) {
  SHIFTMAP_CHECK(calendar.phases > 0, "{} phases", calendar.phases);
  SHIFTMAP_CHECK(gap_resolution >= 0.0, "gap resolution {}", gap_resolution);
  ChainSteps steps;
  steps.states = history.states;
  steps.phases = calendar.phases;
  Builder builder(&steps, gap_resolution);
  const Eigen::VectorXd nothing_seen = Eigen::VectorXd::Ones(history.states);
  for (std::size_t i = 0; i < history.visits.size(); ++i) {
    const ChainVisit& visit = history.visits[i];
    const double largest = visit.log_likelihoods.maxCoeff();
    steps.log_scale += largest;
    const Eigen::VectorXd likelihoods = visit.log_likelihoods.unaryExpr(
        [largest](double value) { return std::exp(value - largest); });
    if (i == 0) {
      builder.AddFirst(likelihoods);
      continue;
    }
    const std::vector<ChainSteps::Gap> pieces =
        CutGap(history.visits[i - 1].end, visit.begin, calendar);
    for (std::size_t k = 0; k < pieces.size(); ++k) {
      builder.Add(pieces[k], k + 1 == pieces.size() ? likelihoods : nothing_seen);
    }
  }
  builder.Finish();
  return steps;
}

}  // namespace shiftmap
