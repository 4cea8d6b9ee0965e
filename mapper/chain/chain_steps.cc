// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/chain_steps.h"

#include <cmath>
#include <cstdint>
#include <unordered_map>

#include "proto/core/check.h"

namespace shiftmap {
namespace {

// What gaps of one index have in common.
struct GapKey {
  std::int64_t length_class = 0;  // Of a gap within a phase.
  int phase = 0;
  int power = -1;  // Of a gap of 2^power whole phases.

  bool operator==(const GapKey& other) const {
    return length_class == other.length_class && phase == other.phase && power == other.power;
  }
};

struct HashOfKey {
  std::size_t operator()(const GapKey& key) const {
    std::uint64_t mixed = static_cast<std::uint64_t>(key.length_class);
    for (const int part : {key.phase, key.power}) {
      mixed = (mixed + static_cast<std::uint64_t>(part)) * 0x9E3779B97F4A7C15u;
      mixed ^= mixed >> 32;
    }
    return static_cast<std::size_t>(mixed);
  }
};

class Builder {
 public:
  Builder(const RhythmCalendar& calendar, double gap_resolution, ChainSteps* steps)
      : calendar_(calendar), log_resolution_(std::log1p(gap_resolution)), steps_(steps) {}

  void AddFirst() { steps_->gap_of_step.push_back(-1); }

  // Cuts [begin, begin + elapsed) where a phase of the calendar ends.
  void Add(Stamp begin, Duration elapsed) {
    if (calendar_.phases == 1) return AddPart(0, elapsed);
    Duration into = calendar_.Into(begin);
    const int phase = calendar_.PhaseOf(into);
    const Duration of_phase = calendar_.EndOf(phase) - into;
    if (elapsed <= of_phase) return AddPart(phase, elapsed);
    AddPart(phase, of_phase);
    elapsed -= of_phase;
    into = calendar_.EndOf(phase) + elapsed % calendar_.period;
    std::int64_t periods = elapsed / calendar_.period;
    if (into >= calendar_.period) {
      into -= calendar_.period;
      ++periods;
    }
    const int last = calendar_.PhaseOf(into);
    AddWhole(phase + 1, periods * calendar_.phases + last);
    const Duration rest = into - (last == 0 ? Duration::zero() : calendar_.EndOf(last - 1));
    if (rest > Duration::zero()) AddPart(last, rest);
  }

  void Finish() {
    if (!(log_resolution_ > 0.0)) return;
    for (std::size_t i = 0; i < steps_->gaps.size(); ++i) {
      if (counts_[i] > 0.0) steps_->gaps[i].length = FromSeconds(totals_s_[i] / counts_[i]);
    }
  }

 private:
  void AddPart(int phase, Duration length) {
    const int index = IndexOf({ClassOf(length), phase}, {length, phase});
    totals_s_[static_cast<std::size_t>(index)] += ToSeconds(length);
    counts_[static_cast<std::size_t>(index)] += 1.0;
    steps_->gap_of_step.push_back(index);
  }

  // Phases number `begin` to `end` - 1, counted from the begin of a period, as the fewest gaps of
  // 2^k phases that begin at a multiple of 2^k.
  void AddWhole(std::int64_t begin, std::int64_t end) {
    while (begin < end) {
      int power = 0;
      for (std::int64_t size = 2; begin % size == 0 && begin + size <= end; size *= 2) ++power;
      steps_->gap_of_step.push_back(WholePhases(begin, power));
      begin += std::int64_t{1} << power;
    }
  }

  int WholePhases(std::int64_t begin, int power) {
    const auto phase = static_cast<int>(begin % calendar_.phases);
    const GapKey key{0, phase, power};
    const auto found = index_.find(key);
    if (found != index_.end()) return found->second;
    if (power == 0) {
      const Duration start = phase == 0 ? Duration::zero() : calendar_.EndOf(phase - 1);
      return IndexOf(key, {calendar_.EndOf(phase) - start, phase});
    }
    const int first = WholePhases(begin, power - 1);
    const int second = WholePhases(begin + (std::int64_t{1} << (power - 1)), power - 1);
    const Duration length = steps_->gaps[static_cast<std::size_t>(first)].length +
                            steps_->gaps[static_cast<std::size_t>(second)].length;
    return IndexOf(key, {length, phase, first, second});
  }

  int IndexOf(const GapKey& key, const ChainSteps::Gap& gap) {
    const auto [found, added] = index_.try_emplace(key, static_cast<int>(steps_->gaps.size()));
    if (added) {
      steps_->gaps.push_back(gap);
      totals_s_.push_back(0.0);
      counts_.push_back(0.0);
    }
    return found->second;
  }

  std::int64_t ClassOf(Duration length) const {
    if (!(log_resolution_ > 0.0) || length <= Duration(0)) return length.count();
    return std::llround(std::log(ToSeconds(length)) / log_resolution_);
  }

  RhythmCalendar calendar_;
  double log_resolution_;
  ChainSteps* steps_;
  std::unordered_map<GapKey, int, HashOfKey> index_;
  std::vector<double> totals_s_;  // Per gap within a phase, over the steps that have it.
  std::vector<double> counts_;
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
  Builder builder(calendar, gap_resolution, &steps);
  for (std::size_t i = 0; i < history.visits.size(); ++i) {
    const ChainVisit& visit = history.visits[i];
    if (i == 0) {
      builder.AddFirst();
    } else {
      const Stamp end = history.visits[i - 1].end;
      builder.Add(end, visit.begin - end);
    }
    const double largest = visit.log_likelihoods.maxCoeff();
    steps.visits.push_back({static_cast<int>(steps.gap_of_step.size()) - 1, largest});
    steps.log_scale += largest;
  }
  builder.Finish();
  steps.likelihoods.setOnes(steps.states, static_cast<Eigen::Index>(steps.gap_of_step.size()));
  for (std::size_t i = 0; i < history.visits.size(); ++i) {
    const ChainSteps::Visit& visit = steps.visits[i];
    steps.likelihoods.col(visit.step) =
        (history.visits[i].log_likelihoods.array() - visit.log_scale).exp();
  }
  return steps;
}

ChainSteps FirstVisits(const ChainSteps& steps, std::size_t visits) {
  SHIFTMAP_CHECK(
      visits >= 1 && visits <= steps.visits.size(), "{} of {} visits", visits, steps.visits.size());
  const auto count = static_cast<std::ptrdiff_t>(visits);
  const Eigen::Index last = steps.visits[visits - 1].step;
  ChainSteps first;
  first.states = steps.states;
  first.phases = steps.phases;
  first.gaps = steps.gaps;
  first.gap_of_step.assign(steps.gap_of_step.begin(), steps.gap_of_step.begin() + last + 1);
  first.likelihoods = steps.likelihoods.leftCols(last + 1);
  first.visits.assign(steps.visits.begin(), steps.visits.begin() + count);
  for (const ChainSteps::Visit& visit : first.visits) first.log_scale += visit.log_scale;
  return first;
}

}  // namespace shiftmap
