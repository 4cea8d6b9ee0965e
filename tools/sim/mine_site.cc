// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/mine_site.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>

#include "tools/sim/option_checks.h"
#include "tools/sim/random.h"
#include "tools/sim/tunnels.h"

namespace shiftmap {
namespace {

// In front of what it is mounted on, so that this does not hide it. [m]
constexpr double kMountingM = 0.05;

// Tags are on walls within this of the path, this far from across it at most.
constexpr double kTagReachM = 10.0;
constexpr double kTagTurnRad = 0.6;

// Of random numbers: others of the same seed are for other things.
constexpr int kSiteStream = -2;

std::string Numbered(const char* kind, std::size_t number, std::size_t count) {
  const std::size_t digits = fmt::formatted_size("{}", count);
  return fmt::format("{}{:0{}}", kind, number, digits);
}

void HangBarriers(int places, Random* random, MineSite* site) {
  std::vector<Wall> entries = site->plan.entries;
  // Not std::shuffle, which may differ between standard libraries.
  for (std::size_t i = entries.size(); i > 1; --i) {
    std::swap(entries[i - 1],
              entries[std::uniform_int_distribution<std::size_t>(0, i - 1)(*random)]);
  }
  const auto size = static_cast<std::size_t>(places);
  const std::size_t count = (entries.size() + size - 1) / size;
  for (std::size_t b = 0; b < count; ++b) {
    SimulatedGroup group{Signature(Numbered("B", b + 1, count)), {}};
    std::vector<Wall>& closed = site->barriers.emplace_back();
    for (std::size_t i = b; i < entries.size(); i += count) {
      const Eigen::Vector2d along = (entries[i].b - entries[i].a).normalized();
      const Eigen::Vector2d to_drift(-along.y(), along.x());
      group.modes.emplace_back(0.5 * (entries[i].a + entries[i].b) + kMountingM * to_drift);
      closed.push_back(entries[i]);
    }
    site->groups.push_back(std::move(group));
  }
}

void SignCorners(MineSite* site) {
  site->corners = site->plan.corners.size();
  for (std::size_t c = 0; c < site->corners; ++c) {
    const MovedCorner& corner = site->plan.corners[c];
    site->groups.push_back(
        {Signature(Numbered("C", c + 1, site->corners)), {corner.original, corner.modified}});
  }
}

// Finds places for tags.
class TagHanger {
 public:
  TagHanger(const MinePlan& plan, double gap_m, Random* random)
      : path_(plan.path),
        length_m_(LengthOf(path_)),
        gap_m_(gap_m),
        original_(plan.original),
        modified_(plan.modified),
        closed_(plan.entries),
        random_(random) {}

  StatusOr<Eigen::Vector2d> Hang() {
    constexpr int kMaxTries = 10000;
    for (int tries = 0; tries < kMaxTries; ++tries) {
      const std::optional<Eigen::Vector2d> place = Try();
      if (!place) continue;
      places_.push_back(*place);
      return *place;
    }
    return InvalidArgument(
        "world: {} places of tags at least {} m apart, more do not fit", places_.size(), gap_m_);
  }

 private:
  // A random look from the path to one side.
  std::optional<Eigen::Vector2d> Try() {
    constexpr double kAheadM = 0.5;
    const double at = Uniform(0.0, length_m_, random_);
    const Eigen::Vector2d p = PointAlong(path_, at);
    const Eigen::Vector2d ahead = PointAlong(path_, at + kAheadM) - PointAlong(path_, at - kAheadM);
    const double side = Happens(0.5, random_) ? 0.5 : -0.5;
    const double yaw = std::atan2(ahead.y(), ahead.x()) + side * std::numbers::pi +
                       Uniform(-kTagTurnRad, kTagTurnRad, random_);
    const Eigen::Vector2d look(std::cos(yaw), std::sin(yaw));
    const double range = original_.Cast(p, look, kTagReachM).range_m;
    if (!(range > kMountingM && range < kTagReachM)) return std::nullopt;
    if (modified_.Cast(p, look, kTagReachM).range_m != range) return std::nullopt;
    if (closed_.Cast(p, look, range).hit()) return std::nullopt;
    const Eigen::Vector2d place = p + (range - kMountingM) * look;
    const bool free = std::all_of(places_.begin(), places_.end(), [&](const auto& other) {
      return (other - place).norm() >= gap_m_;
    });
    return free ? std::optional(place) : std::nullopt;
  }

  std::vector<Eigen::Vector2d> path_;
  double length_m_;
  double gap_m_;
  RayCaster original_;
  RayCaster modified_;
  RayCaster closed_;  // Barriers only.
  Random* random_;
  std::vector<Eigen::Vector2d> places_;
};

}  // namespace

Status MineLandmarkOptions::Validate() const {
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("places per barrier", places_per_barrier));
  SHIFTMAP_RETURN_IF_ERROR(CheckNotNegative("tags", tags));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("places per tag", places_per_tag));
  return CheckNotNegative("distance of places", place_gap_m);
}

std::vector<ModeNumber> MineSite::WithCornersOf(PlanVersion version,
                                                std::vector<ModeNumber> active_mode) const {
  const ModeNumber mode(version == PlanVersion::kOriginal ? 1 : 2);
  std::fill_n(active_mode.begin() + static_cast<std::ptrdiff_t>(barriers.size()), corners, mode);
  return active_mode;
}

std::vector<int> MineSite::ModeCounts() const {
  std::vector<int> counts;
  for (const SimulatedGroup& group : groups) counts.push_back(static_cast<int>(group.modes.size()));
  return counts;
}

std::vector<Wall> MineSite::WallsOf(PlanVersion version,
                                    const std::vector<ModeNumber>& active_mode) const {
  std::vector<Wall> walls = plan.walls(version);
  for (std::size_t b = 0; b < barriers.size(); ++b) {
    if (active_mode[b] == kAbsent) continue;
    walls.push_back(barriers[b][static_cast<std::size_t>(active_mode[b].value() - 1)]);
  }
  return walls;
}

StatusOr<MineSite> MakeMineSite(MinePlan plan, const MineLandmarkOptions& options) {
  SHIFTMAP_RETURN_IF_ERROR(options.Validate());
  MineSite site;
  site.plan = std::move(plan);
  Random random = MakeRandom(options.seed, kSiteStream);
  HangBarriers(options.places_per_barrier, &random, &site);
  if (options.corners) SignCorners(&site);
  TagHanger hanger(site.plan, options.place_gap_m, &random);
  const auto tags = static_cast<std::size_t>(options.tags);
  for (std::size_t t = 0; t < tags; ++t) {
    SimulatedGroup group{Signature(Numbered("T", t + 1, tags)), {}};
    for (int place = 0; place < options.places_per_tag; ++place) {
      SHIFTMAP_ASSIGN_OR_RETURN(const Eigen::Vector2d p, hanger.Hang());
      group.modes.push_back(p);
    }
    site.groups.push_back(std::move(group));
  }
  return site;
}

}  // namespace shiftmap
