// SPDX-License-Identifier: Apache-2.0
#include "tools/inspect/diff_text.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>
#include <vector>

#include "mapstore/cli/aligned_table.h"
#include "mapstore/core/count_text.h"
#include "mapstore/core/day.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/core/mode_name.h"
#include "tools/inspect/landmark_history.h"
#include "tools/inspect/landmark_text.h"
#include "tools/inspect/store_arguments.h"

namespace shiftmap {
namespace {

constexpr std::size_t kScreenRows = 20;

// Less than this does not show in three decimals. [m, or a probability]
constexpr double kLeastShown = 5e-4;

// Kinds of change, the most important first.
enum class Kind { kLandmark, kMoved, kModes, kHolds, kRate, kSmall };

struct Line {
  Kind kind = Kind::kSmall;
  double size = 0.0;  // The larger, the earlier among its kind.
  std::string signature;
  std::string mode;
  std::string change;
  std::string detail;
};

// Small changes that the text only counts.
struct Sums {
  int moves = 0;
  double largest_m = 0.0;
  double total_m = 0.0;
  int rates = 0;
  int covariances = 0;
};

// The mode that most likely holds, and its probability.
std::pair<ModeNumber, double> Holding(const LandmarkGroup& group) {
  Eigen::Index best = 0;
  const double probability = group.probabilities.maxCoeff(&best);
  return {group.NumberOf(static_cast<int>(best)), probability};
}

const LandmarkGroup& GroupOf(const MapSnapshot& map, const Signature& signature) {
  return map.groups()[static_cast<std::size_t>(map.GroupIndex(signature))];
}

// The difference of a group without what the printed digits do not show.
GroupDiff Shown(GroupDiff group) {
  std::erase_if(group.moved, [](const MovedMode& mode) {
    return mode.displacement_m.norm() < kLeastShown &&
           mode.squared_mahalanobis <= kMovedSquaredMahalanobis;
  });
  if (group.probability_change < kLeastShown) group.probability_change = 0.0;
  return group;
}

std::string PlaceText(const LandmarkGroup& group, ModeNumber number) {
  const int state = group.StateOf(number);
  if (state < 1) return "";
  const Eigen::Vector2d& p = group.modes[static_cast<std::size_t>(state) - 1].p_map_landmark;
  return fmt::format("at ({:.2f}, {:.2f}) m", p.x(), p.y());
}

class DiffLines {
 public:
  DiffLines(const MapSnapshot& from, const MapSnapshot& to, const MoveRates& rates, bool all)
      : from_(from), to_(to), rates_(rates), all_(all) {}

  void AddLandmark(const Signature& signature, const MapSnapshot& map, const char* change) {
    const LandmarkGroup& group = GroupOf(map, signature);
    lines_.push_back({Kind::kLandmark,
                      0.0,
                      signature.text(),
                      "",
                      change,
                      CountText(group.modes.size(), "mode")});
  }

  void AddGroup(const GroupDiff& diff) {
    const LandmarkGroup& before = GroupOf(from_, diff.signature);
    const LandmarkGroup& after = GroupOf(to_, diff.signature);
    const std::string& name = diff.signature.text();
    const auto add =
        [&](Kind kind, double size, ModeNumber mode, std::string change, std::string detail) {
          lines_.push_back({kind,
                            size,
                            name,
                            fmt::format("{}", mode.value()),
                            std::move(change),
                            std::move(detail)});
        };
    for (const ModeNumber mode : diff.added) {
      add(Kind::kModes, 3.0, mode, "new mode", PlaceText(after, mode));
    }
    for (const ModeNumber mode : diff.removed) {
      add(Kind::kModes, 2.0, mode, "mode gone", PlaceText(before, mode));
    }
    for (const MergedMode& mode : diff.merged) {
      add(Kind::kModes,
          1.0,
          mode.number,
          "mode merged",
          fmt::format("into mode {}", mode.into.value()));
    }
    for (const MovedMode& mode : diff.moved) AddMove(name, mode);
    AddHolding(diff, before, after);
    AddRate(diff);
    if (diff.uncertainty_changed) ++sums_.covariances;
  }

  const Sums& sums() const { return sums_; }

  // By importance, then size, then signature.
  std::vector<Line> Sorted() {
    std::stable_sort(lines_.begin(), lines_.end(), [](const Line& a, const Line& b) {
      return std::tuple(a.kind, -a.size) < std::tuple(b.kind, -b.size);
    });
    return std::move(lines_);
  }

 private:
  void AddMove(const std::string& name, const MovedMode& mode) {
    const bool beyond = mode.squared_mahalanobis > kMovedSquaredMahalanobis;
    const double distance_m = mode.displacement_m.norm();
    if (!beyond) {
      ++sums_.moves;
      sums_.total_m += distance_m;
      sums_.largest_m = std::max(sums_.largest_m, distance_m);
      if (!all_) return;
    }
    lines_.push_back({beyond ? Kind::kMoved : Kind::kSmall,
                      mode.squared_mahalanobis,
                      name,
                      fmt::format("{}", mode.number.value()),
                      beyond ? "moved" : "shifted",
                      fmt::format("{:.3f} m by ({:.3f}, {:.3f}) m, {:.1f} standard deviations",
                                  distance_m,
                                  mode.displacement_m.x(),
                                  mode.displacement_m.y(),
                                  std::sqrt(mode.squared_mahalanobis))});
  }

  void AddHolding(const GroupDiff& diff, const LandmarkGroup& before, const LandmarkGroup& after) {
    const auto [was, was_probability] = Holding(before);
    const auto [is, is_probability] = Holding(after);
    const bool was_decided = IsDecided(was_probability);
    const bool is_decided = IsDecided(is_probability);
    const bool other = (before.CarriedStateOf(was) < 0 || was != is) && (was_decided || is_decided);
    if (!other && (!all_ || diff.probability_change == 0.0)) return;
    lines_.push_back({other ? Kind::kHolds : Kind::kSmall,
                      diff.probability_change,
                      diff.signature.text(),
                      is_decided ? fmt::format("{}", is.value()) : "-",
                      !is_decided ? "undecided" : (other ? "holds now" : "holds still"),
                      other
                          ? fmt::format("P {:.3f}, was {} with P {:.3f}",
                                        is_probability,
                                        was_decided ? ModeName(was) : "undecided",
                                        was_probability)
                          : fmt::format("P {:.3f}, was {:.3f}", is_probability, was_probability)});
  }

  void AddRate(const GroupDiff& diff) {
    if (!diff.rates_changed) return;
    const auto found = rates_.find(diff.signature);
    const double from = diff.from_move_rate_per_s;
    const double to = diff.to_move_rate_per_s;
    const bool within = found != rates_.end() && from >= found->second.low_per_s &&
                        from <= found->second.high_per_s;
    if (within) {
      ++sums_.rates;
      if (!all_) return;
    }
    std::string detail =
        fmt::format("{:.3g} to {:.3g} a day", kSecondsPerDay * from, kSecondsPerDay * to);
    if (found != rates_.end()) {
      detail += fmt::format(" ({:.3g} to {:.3g})",
                            kSecondsPerDay * found->second.low_per_s,
                            kSecondsPerDay * found->second.high_per_s);
    }
    const bool finite = from > 0.0 && to > 0.0;
    lines_.push_back({within ? Kind::kSmall : Kind::kRate,
                      finite ? std::abs(std::log(to / from)) : HUGE_VAL,
                      diff.signature.text(),
                      "",
                      "move rate",
                      std::move(detail)});
  }

  const MapSnapshot& from_;
  const MapSnapshot& to_;
  const MoveRates& rates_;
  bool all_;
  std::vector<Line> lines_;
  Sums sums_;
};

std::string CalibrationText(const MapDiff& diff, bool all, const TextStyle& style) {
  std::string text;
  for (const std::string& vehicle : diff.vehicles_added) {
    text += fmt::format("vehicle {} is calibrated by itself now\n", InertLine(vehicle));
  }
  for (const std::string& vehicle : diff.vehicles_removed) {
    text += fmt::format("vehicle {} is not calibrated by itself any more\n", InertLine(vehicle));
  }
  if (diff.calibration.empty()) return text;
  if (!all) return text + fmt::format("{} calibration values changed\n", diff.calibration.size());
  AlignedTable table({"vehicle", "calibration", "from", "to"});
  for (const CalibrationChange& change : diff.calibration) {
    table.AddRow({change.vehicle.empty() ? "fleet" : change.vehicle,
                  change.name,
                  fmt::format("{:.4g}", change.from),
                  fmt::format("{:.4g}", change.to)});
  }
  return text + table.ToString(style);
}

std::string SumsText(const Sums& sums, const MapDiff& diff, std::size_t unchanged) {
  std::string text;
  if (sums.moves > 0) {
    text += fmt::format(
        "{} shifted within their covariance, by {:.3f} m on average and at most {:.3f} m\n",
        CountText(sums.moves, "mode"),
        sums.total_m / sums.moves,
        sums.largest_m);
  }
  if (sums.rates > 0) {
    text +=
        fmt::format("{} changed within their 95 % intervals\n", CountText(sums.rates, "move rate"));
  }
  if (sums.covariances > 0) {
    text += fmt::format("other covariances: {}\n", CountText(sums.covariances, "landmark"));
  }
  if (diff.anonymous_changed) {
    text += fmt::format("anonymous landmarks: {} to {}\n", diff.anonymous_from, diff.anonymous_to);
  }
  return text + fmt::format("unchanged: {}\n", CountText(unchanged, "landmark"));
}

}  // namespace

std::string DiffText(const EarlierMap& earlier,
                     const MapSnapshot& to,
                     const MapDiff& diff,
                     const MoveRates& rates,
                     bool all,
                     const TextStyle& style) {
  const MapSnapshot& from = earlier.map;
  const std::string frame = earlier.moved ? fmt::format("the frame {}; moves are what is left\n",
                                                        FrameText(*earlier.moved))
                                          : "";
  if (diff.empty()) return frame.empty() ? "no difference\n" : frame + "no other difference\n";
  std::string text = fmt::format("area {}: version {} ({} UTC) to version {} ({} UTC)\n",
                                 InertLine(from.area()),
                                 from.version().value(),
                                 TimeText(from.stamp()),
                                 to.version().value(),
                                 TimeText(to.stamp()));
  text += frame;
  DiffLines lines(from, to, rates, all);
  for (const Signature& signature : diff.groups_removed) {
    lines.AddLandmark(signature, from, "landmark gone");
  }
  for (const Signature& signature : diff.groups_added) {
    lines.AddLandmark(signature, to, "new landmark");
  }
  std::size_t changed = 0;
  for (const GroupDiff& group : diff.groups) {
    const GroupDiff shown = Shown(group);
    if (shown.empty()) continue;
    lines.AddGroup(shown);
    ++changed;
  }
  const std::vector<Line> sorted = lines.Sorted();
  if (!sorted.empty()) {
    AlignedTable table({"signature", "mode", "change", "detail"});
    const std::size_t shown = all ? sorted.size() : std::min(sorted.size(), kScreenRows);
    for (std::size_t i = 0; i < shown; ++i) {
      const Line& line = sorted[i];
      table.AddRow({line.signature, line.mode, line.change, line.detail},
                   line.kind == Kind::kLandmark ? Emphasis::kAlarm : Emphasis::kNone);
    }
    text += "\n" + table.ToString(style);
    if (shown < sorted.size()) {
      text += fmt::format("{} more changes: --all shows them\n", sorted.size() - shown);
    }
  }
  const std::size_t unchanged = to.groups().size() - diff.groups_added.size() - changed;
  return text + "\n" + SumsText(lines.sums(), diff, unchanged) + CalibrationText(diff, all, style);
}

}  // namespace shiftmap
