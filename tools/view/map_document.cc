// SPDX-License-Identifier: Apache-2.0
#include "tools/view/map_document.h"

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>
#include <vector>

#include "mapstore/cli/version.h"
#include "mapstore/core/clock.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/find_version.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/map/frame_change.h"
#include "tools/plot/free_network.h"
#include "tools/view/compact_values.h"
#include "tools/view/replay_document.h"

namespace shiftmap {
namespace {

constexpr int kFormat = 1;

// They keep the page of a map with 10,000 modes below 5 MB.
constexpr std::int64_t kMaxVersions = 12;    // The newest, and the one that is shown first.
constexpr std::int64_t kMaxModes = 30'000;   // Of all versions; that one always goes in.
constexpr std::int64_t kMaxVisits = 20'000;  // Of all landmarks; the newest.
constexpr std::int64_t kMaxPoints = 30'000;  // Of all probabilities over time; the newest.
constexpr std::size_t kMaxPoses = 60'000;    // Of all trajectories, which are thinned.

Json ProbabilitiesJson(const Eigen::VectorXd& probabilities) {
  Json json = Json::array();
  for (const double p : probabilities) json.push_back(Scaled(p, 1e-4));
  return json;
}

// Longer sd, shorter sd, direction.
void AddEllipse(const Mode& mode, Json* json) {
  const SigmaEllipse ellipse = MakeSigmaEllipse(mode.cov_p_map_landmark);
  json->insert(json->end(),
               {Scaled(ellipse.major_m, kTenthMillimetre),
                Scaled(ellipse.minor_m, kTenthMillimetre),
                Scaled(ellipse.rotation_rad, 1e-3)});
}

// The columns of a mode: number, x, y, its ellipse, last seen.
void AddMode(const Mode& mode, Json* json) {
  json->insert(json->end(),
               {mode.number.value(),
                Scaled(mode.p_map_landmark.x(), kTenthMillimetre),
                Scaled(mode.p_map_landmark.y(), kTenthMillimetre)});
  AddEllipse(mode, json);
  json->push_back(Scaled(ToSecondsSinceEpoch(mode.last_seen), 1.0));
}

// Standard deviation of the scale, then of each mode: longer sd, shorter sd, direction. Nothing of
// a map whose modes no covariance connects.
Json FreeNetworkJson(const FreeMap& free) {
  Json json = Json::array();
  if (!free.connected) return json;
  json.push_back(Rounded(free.scale_sd, 2));
  for (const LandmarkGroup& group : free.content.groups) {
    for (const Mode& mode : group.modes) AddEllipse(mode, &json);
  }
  return json;
}

// Moves LandmarkTracks::since on until at most so many points begin after it.
void DropOldest(LandmarkTracks* tracks) {
  std::vector<Stamp> begins;
  for (const std::vector<TrackPoint>& points : tracks->points) {
    for (const TrackPoint& point : points) begins.push_back(point.begin);
  }
  if (static_cast<std::int64_t>(begins.size()) <= kMaxPoints) return;
  const auto cut = begins.end() - kMaxPoints;
  std::nth_element(begins.begin(), cut, begins.end());
  tracks->since = std::max(tracks->since, *cut);
  for (std::vector<TrackPoint>& points : tracks->points) {
    // The last one before holds from there on.
    const auto kept = std::upper_bound(
        points.begin(), points.end(), tracks->since, [](Stamp since, const TrackPoint& point) {
          return since < point.begin;
        });
    if (kept - points.begin() > 1) points.erase(points.begin(), kept - 1);
  }
  for (std::vector<LandmarkVisit>& visits : tracks->visits) {
    const auto kept = std::find_if(visits.begin(), visits.end(), [&](const LandmarkVisit& visit) {
      return visit.evidence.begin >= tracks->since;
    });
    visits.erase(visits.begin(), kept);
  }
}

class DocumentWriter {
 public:
  DocumentWriter(const std::string& area, const MapDocumentOptions& options, MapStore* store)
      : area_(area), options_(options), store_(store), rates_left_(options.max_rhythm_rates) {}

  StatusOr<Json> Write();

 private:
  Status SelectVersions();
  Stamp StampOf(VersionNumber version) const;
  StatusOr<Json> MapsJson();
  StatusOr<MapSnapshot> Load(VersionNumber version, Stamp at);
  Json MapRowJson(VersionNumber version, const MapContent& map, const FreeMap& free);
  Json BoundedRhythmJson(const ChainRhythm& rhythm);
  Status AddTracks(Json* document);
  Json VisitJson(const LandmarkVisit& visit, Stamp origin);
  StatusOr<Json> RunsJson();
  Json RunJson(const RunRecord& run, VersionNumber version, std::size_t stride);

  const std::string& area_;
  const MapDocumentOptions& options_;
  MapStore* store_;
  std::int64_t rates_left_;
  std::vector<VersionSummary> versions_;
  std::optional<VersionNumber> published_;
  VersionNumber shown_;
  LandmarkNames names_of_shown_;
  std::map<VersionNumber, Se2> frames_;  // T_shown_version of the ancestors.
  std::int64_t versions_left_out_ = 0;
  TextTable signatures_;
  TextTable vehicles_;
  TextTable names_;
};

Status DocumentWriter::SelectVersions() {
  SHIFTMAP_ASSIGN_OR_RETURN(versions_, store_->Versions(area_));
  if (options_.known) {
    std::erase_if(versions_,
                  [&](const VersionSummary& version) { return version.created > *options_.known; });
    SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, store_->LoadKnown(area_, *options_.known));
    published_ = map.version();
  } else {
    SHIFTMAP_ASSIGN_OR_RETURN(published_, store_->PublishedVersion(area_));
  }
  if (!options_.version && !published_) {
    return NotFound("area '{}' has no published version", area_);
  }
  shown_ = options_.version ? *options_.version : *published_;
  return OkStatus();
}

StatusOr<MapSnapshot> DocumentWriter::Load(VersionNumber version, Stamp at) {
  return options_.known ? store_->LoadKnown(area_, *options_.known, version, at)
                        : store_->LoadAt(area_, version, at);
}

Stamp DocumentWriter::StampOf(VersionNumber number) const {
  const VersionSummary* const version = FindVersion(versions_, number);
  return version == nullptr ? Stamp() : version->stamp;
}

// Without its rates, if they are too many for the page.
Json DocumentWriter::BoundedRhythmJson(const ChainRhythm& rhythm) {
  Json json = RhythmRatesJson(rhythm);
  const auto rates = static_cast<std::int64_t>(json.size()) - 1;
  if (rates > rates_left_) return Json::array({std::move(json[0])});
  rates_left_ -= rates;
  return json;
}

Json DocumentWriter::MapRowJson(VersionNumber version, const MapContent& map, const FreeMap& free) {
  Json groups = Json::array();
  for (const LandmarkGroup& group : map.groups) {
    Json modes = Json::array();
    for (const Mode& mode : group.modes) AddMode(mode, &modes);
    Json row = {signatures_.Add(group.signature.text()),
                RatesJson(group.chain),
                std::move(modes),
                ProbabilitiesJson(group.probabilities)};
    // Only what is shown moves in time.
    const ChainRhythm* const rhythm = version == shown_ ? group.chain.rhythm() : nullptr;
    if (rhythm != nullptr) row.push_back(BoundedRhythmJson(*rhythm));
    groups.push_back(std::move(row));
  }
  Json anonymous = Json::array();
  for (const Mode& mode : map.anonymous_landmarks) AddMode(mode, &anonymous);
  return Json::array(
      {version.value(), std::move(groups), std::move(anonymous), FreeNetworkJson(free)});
}

// The version that is shown, and the newest others as they were built, with its names and in its
// frame.
StatusOr<Json> DocumentWriter::MapsJson() {
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot shown, Load(shown_, StampOf(shown_)));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> shown_edits, store_->EditsOf(area_, shown_));
  names_of_shown_ = LandmarkNames(shown_edits);
  Json maps = Json::array({MapRowJson(shown_, shown.content(), FreeNetwork(shown.content()))});
  std::int64_t modes = shown.covariance().size();
  const auto add = [&](VersionNumber version, Stamp stamp) -> Status {
    SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, Load(version, stamp));
    modes += map.covariance().size();
    if (modes > kMaxModes) {
      ++versions_left_out_;
      return OkStatus();
    }
    SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> edits, store_->EditsOf(area_, version));
    const LandmarkNames names(edits);
    const CarriedMap carried = CarryMap(map.content(), names, shown.content(), names_of_shown_);
    FreeMap free = FreeNetwork(map.content());
    free.content = WithNames(std::move(free.content), names, names_of_shown_);
    if (carried.moved) MoveContent(*carried.moved, &free.content);
    maps.push_back(MapRowJson(version, carried.content, free));
    return OkStatus();
  };
  for (auto version = versions_.rbegin(); version != versions_.rend(); ++version) {
    if (version->version == shown_ || !version->content_stored) continue;
    if (modes > kMaxModes || static_cast<std::int64_t>(maps.size()) >= kMaxVersions) {
      ++versions_left_out_;
      continue;
    }
    SHIFTMAP_RETURN_IF_ERROR(add(version->version, version->stamp));
  }
  return maps;
}

Json DocumentWriter::RunJson(const RunRecord& run, VersionNumber version, std::size_t stride) {
  Json path = Json::array();
  std::int64_t x = 0;
  std::int64_t y = 0;
  for (std::size_t i = 0; i < run.trajectory.size(); i += stride) {
    const Se2& pose = run.trajectory[i].T_map_vehicle;
    const std::int64_t next_x = Scaled(pose.x(), 0.01);
    const std::int64_t next_y = Scaled(pose.y(), 0.01);
    path.push_back(next_x - x);
    path.push_back(next_y - y);
    x = next_x;
    y = next_y;
  }
  return Json::array({names_.Add(run.name),
                      vehicles_.Add(run.vehicle),
                      ToSecondsSinceEpoch(run.begin),
                      ToSecondsSinceEpoch(run.end),
                      version.value(),
                      std::move(path)});
}

// The favoured mode of a visit, and its log-likelihood ratio to the next.
std::pair<ModeNumber, double> Favoured(const VisitEvidence& evidence) {
  std::vector<VisitEvidence::ModeLogLikelihood> modes = evidence.modes;
  if (modes.empty()) return {kAbsent, 0.0};
  std::partial_sort(
      modes.begin(),
      modes.begin() + std::min<std::ptrdiff_t>(2, static_cast<std::ptrdiff_t>(modes.size())),
      modes.end(),
      [](const auto& a, const auto& b) { return a.log_likelihood > b.log_likelihood; });
  const double ratio = modes.size() > 1 ? modes[0].log_likelihood - modes[1].log_likelihood : 0.0;
  return {modes[0].mode, ratio};
}

Json DocumentWriter::VisitJson(const LandmarkVisit& visit, Stamp origin) {
  const VisitEvidence& evidence = visit.evidence;
  const auto [favoured, ratio] = Favoured(evidence);
  const Decision decision = visit.decision.value_or(Decision{{}, ModeNumber(-1), {}, 0.0});
  return Json::array({Milliseconds(evidence.begin, origin),
                      Milliseconds(evidence.end, origin),
                      vehicles_.Add(visit.vehicle),
                      names_.Add(visit.run_name.empty() ? visit.run : visit.run_name),
                      visit.mapped() ? 1 : 0,
                      visit.version.value(),
                      evidence.observations,
                      favoured.value(),
                      Tenths(ratio),
                      decision.mode.value(),
                      Tenths(decision.log_odds),
                      visit.set_aside ? Describe(*visit.set_aside) : "",
                      ProbabilitiesJson(visit.probabilities)});
}

// How the probabilities of the shown version go, and the visits that make them.
Status DocumentWriter::AddTracks(Json* document) {
  SHIFTMAP_ASSIGN_OR_RETURN(LandmarkTracks tracks,
                            store_->LoadTracks(area_, {shown_, kMaxVisits, options_.known}));
  DropOldest(&tracks);
  Stamp origin = tracks.since > Stamp::min() ? tracks.since : Stamp::max();
  for (const auto& points : tracks.points) {
    if (points.size() > 1) origin = std::min(origin, points[1].begin);
  }
  for (const auto& visits : tracks.visits) {
    if (!visits.empty()) origin = std::min(origin, visits.front().evidence.begin);
  }
  if (origin == Stamp::max()) origin = StampOf(shown_);
  Json points_json = Json::array();
  for (const std::vector<TrackPoint>& points : tracks.points) {
    Json row = Json::array();
    for (const TrackPoint& point : points) {
      row.push_back(Milliseconds(std::max(point.begin, origin), origin));
      row.push_back(Milliseconds(point.end, origin));
      const Json probabilities = ProbabilitiesJson(point.probabilities);
      row.insert(row.end(), probabilities.begin(), probabilities.end());
    }
    points_json.push_back(std::move(row));
  }
  Json visits_json = Json::array();
  for (const std::vector<LandmarkVisit>& visits : tracks.visits) {
    Json row = Json::array();
    for (const LandmarkVisit& visit : visits) row.push_back(VisitJson(visit, origin));
    visits_json.push_back(std::move(row));
  }
  (*document)["origin_s"] = ToSecondsSinceEpoch(origin);
  (*document)["tracks"] = std::move(points_json);
  (*document)["visits"] = std::move(visits_json);
  if (tracks.since > Stamp::min()) {
    (*document)["left_out"]["before_s"] = ToSecondsSinceEpoch(tracks.since);
  }
  return OkStatus();
}

// Those that the version and its ancestors were built from, in the version's frame.
StatusOr<Json> DocumentWriter::RunsJson() {
  std::vector<std::pair<VersionNumber, RunRecord>> runs;
  std::size_t poses = 0;
  std::set<std::string> known;
  std::optional<VersionNumber> version = shown_;
  Se2 T_shown_version;
  while (version) {
    SHIFTMAP_ASSIGN_OR_RETURN(Provenance provenance, store_->LoadProvenance(area_, *version));
    for (RunRecord& run : provenance.runs) {
      if (!known.insert(run.identity()).second) continue;
      MoveTrajectory(T_shown_version, &run.trajectory);
      poses += run.trajectory.size();
      runs.emplace_back(*version, std::move(run));
    }
    const std::optional<VersionNumber> parent = ParentOf(versions_, *version);
    SHIFTMAP_ASSIGN_OR_RETURN(const Se2 T_version_parent, store_->FrameStep(area_, *version));
    T_shown_version = T_shown_version * T_version_parent;
    if (parent) frames_[*parent] = T_shown_version;
    // Of a damaged store: parents are older.
    version = parent && *parent < *version ? parent : std::nullopt;
  }
  std::sort(runs.begin(), runs.end(), [](const auto& a, const auto& b) {
    return a.second.begin < b.second.begin;
  });
  const std::size_t stride = std::max<std::size_t>(1, (poses + kMaxPoses - 1) / kMaxPoses);
  Json json = Json::array();
  for (const auto& [mapped_by, run] : runs) json.push_back(RunJson(run, mapped_by, stride));
  return json;
}

StatusOr<Json> DocumentWriter::Write() {
  SHIFTMAP_RETURN_IF_ERROR(SelectVersions());
  SHIFTMAP_ASSIGN_OR_RETURN(Json maps, MapsJson());
  SHIFTMAP_ASSIGN_OR_RETURN(Json runs, RunsJson());
  Json versions = Json::array();
  for (const VersionSummary& version : versions_) {
    versions.push_back({version.version.value(),
                        version.parent ? Json(version.parent->value()) : Json(nullptr),
                        ToSecondsSinceEpoch(version.created),
                        ToSecondsSinceEpoch(version.stamp),
                        version.content_hash,
                        InertLine(version.tool)});
  }
  const Stamp now = SystemNow();
  const Stamp known = options_.known.value_or(now);
  Json document = {{"format", kFormat},
                   {"area", InertLine(area_)},
                   {"tool", "shiftmap-inspect " + SoftwareVersion()},
                   {"made_s", ToSecondsSinceEpoch(now)},
                   {"at_s", ToSecondsSinceEpoch(options_.at.value_or(known))},
                   {"known_s", options_.known ? Json(ToSecondsSinceEpoch(known)) : Json(nullptr)},
                   {"published", published_ ? Json(published_->value()) : Json(nullptr)},
                   {"shown", shown_.value()},
                   {"versions", std::move(versions)},
                   {"maps", std::move(maps)},
                   {"runs", std::move(runs)},
                   {"left_out", {{"versions", versions_left_out_}}}};
  SHIFTMAP_RETURN_IF_ERROR(AddTracks(&document));
  if (options_.replay) {
    ReplayOptions replay;
    replay.frames = frames_;
    replay.aliases = names_of_shown_.Aliases();
    SHIFTMAP_ASSIGN_OR_RETURN(document["replay"],
                              ReplayJson(*options_.replay, area_, replay, &signatures_));
  }
  document["signatures"] = signatures_.TakeJson();
  document["vehicles"] = vehicles_.TakeJson();
  document["names"] = names_.TakeJson();
  return document;
}

}  // namespace

StatusOr<Json> MapDocument(const std::string& area,
                           const MapDocumentOptions& options,
                           MapStore* store) {
  return DocumentWriter(area, options, store).Write();
}

}  // namespace shiftmap
