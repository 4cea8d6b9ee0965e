// SPDX-License-Identifier: Apache-2.0
#include "localizer/recording/shift_recorder.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "localizer/recording/codec/recording_codec.h"
#include "localizer/recording/codec/scene_codec.h"
#include "mapstore/codec/map_message.h"
#include "mapstore/core/atomic_file.h"
#include "mapstore/core/utf8.h"
#include "proto/mcap/writer.h"

namespace shiftmap {
namespace {

constexpr std::string_view kEncoding = "protobuf";

constexpr double kPoseRateHz = 10.0;       // Poses at most. [1/s]
constexpr double kHypothesesRateHz = 2.0;  // Samples of the hypotheses at most. [1/s]
constexpr double kSceneRateHz = 1.0;       // Updates of the map's scene at most. [1/s]
constexpr double kMinChange = 0.02;        // Of a probability that draws a landmark again. [-]

// Of the whole map, drawn at first: messages have a size at most.
constexpr std::size_t kGroupsPerUpdate = 1000;

// They grow with the square of the landmarks near to each other, and nobody draws them.
MapSnapshot WithoutCorrelations(const MapSnapshot& map) {
  MapContent content = map.content();
  std::vector<Eigen::Matrix2d> diagonal;
  for (int i = 0; i < content.covariance.size(); ++i) {
    diagonal.push_back(content.covariance.Block(i, i));
  }
  content.covariance = JointCovariance(std::move(diagonal), {});
  return MapSnapshot(map.area(), map.version(), map.content_hash(), std::move(content));
}

bool SameDecision(const Decision& a, const Decision& b) {
  return a.signature == b.signature && a.mode == b.mode && a.stamp == b.stamp;
}

bool SameChange(const StateChange& a, const StateChange& b) {
  return a.stamp == b.stamp && a.from == b.from && a.to == b.to;
}

// Passes events at a rate of at most `rate_hz`.
class RateLimit {
 public:
  explicit RateLimit(double rate_hz) : period_(FromSeconds(1.0 / rate_hz)) {}

  bool Pass(Stamp stamp) {
    if (last_ && stamp < *last_ + period_) return false;
    last_ = stamp;
    return true;
  }

 private:
  Duration period_;
  std::optional<Stamp> last_;
};

std::string Describe(const StateChange& change) {
  const PoseSupport& support = change.evidence.support;
  std::string text = fmt::format("{} -> {}: {} landmarks agree with the pose, {} do not",
                                 ToString(change.from),
                                 ToString(change.to),
                                 support.agreeing,
                                 support.failing);
  if (!change.evidence.signature.anonymous()) {
    text += fmt::format("; landmark '{}'", change.evidence.signature.text());
  }
  return text;
}

LogLevel LevelOf(LocalizerState state) {
  if (state == LocalizerState::kLost) return LogLevel::kError;
  return state == LocalizerState::kUnknownChange ? LogLevel::kWarning : LogLevel::kInfo;
}

std::string Describe(const DecisionChange& change) {
  const Decision& decision = change.decision;
  const std::string where =
      decision.mode == kAbsent ? "absent" : fmt::format("at mode {}", decision.mode.value());
  return fmt::format("landmark '{}' {}, log-odds {:.1f}{}",
                     decision.signature.text(),
                     where,
                     decision.log_odds,
                     change.withdrawn ? ": taken back" : "");
}

Status AboutRecording(const std::string& path, const Status& status) {
  return Annotate(status, "recording '{}'", path);
}

}  // namespace

struct ShiftRecorder::State {
  State(std::string to, AtomicFile opened)
      : path(std::move(to)),
        file(std::move(opened)),
        writer([this](std::string_view bytes) { return file.Append(bytes); }, {}) {}

  Status Begin(const RecordedShift& shift, const MapSnapshot& of, Stamp begin);
  Status Record(const Localizer& localizer);

  // Log times are unsigned; the message itself keeps a stamp before 1970.
  Status Write(const RecordingTopic& topic, Stamp stamp, const std::string& message) {
    const auto time_ns =
        static_cast<std::uint64_t>(std::max<std::int64_t>(ToNanoseconds(stamp), 0));
    return writer.Write(channels.at(topic.topic), time_ns, message);
  }

  Status RecordPose(const PoseEstimate& estimate, LocalizerState state);
  Status RecordInnovations(const Localizer& localizer);
  Status RecordStates(const Localizer& localizer);
  Status RecordDecisions(const std::vector<Decision>& standing, Stamp now);
  Status RecordDecision(const DecisionChange& change);
  Status RecordHypotheses(const HypothesisBank& bank, const PoseEstimate& now);
  Status RecordScene(const HypothesisBank& bank, Stamp stamp);

  std::string path;
  AtomicFile file;
  mcap::Writer writer;

  RateLimit pose_rate{kPoseRateHz};
  RateLimit hypotheses_rate{kHypothesesRateHz};
  RateLimit scene_rate{kSceneRateHz};
  std::map<std::string_view, std::uint16_t> channels;
  std::optional<MapSnapshot> map;
  std::optional<StateChange> last_state;
  std::vector<Decision> decisions;     // That are recorded and stand.
  std::set<int> visited;               // Groups, since the scene was drawn last.
  std::vector<Eigen::VectorXd> drawn;  // Probabilities by group.
};

Status ShiftRecorder::State::Begin(const RecordedShift& shift, const MapSnapshot& of, Stamp begin) {
  for (const std::string* text : {&shift.vehicle, &shift.area, &shift.run_uuid}) {
    if (!IsUtf8(*text)) return InvalidArgument("'{}' is not UTF-8", *text);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string map_message,
                            EncodeMap(WithoutCorrelations(of), MapForm::kBinary));
  map = of;
  std::map<std::string_view, std::uint16_t> schemas;
  for (const RecordingTopic& topic : {kShiftTopic,
                                      kMapTopic,
                                      kMapSceneTopic,
                                      kPoseTopic,
                                      kTransformTopic,
                                      kPoseEventTopic,
                                      kStateTopic,
                                      kDecisionTopic,
                                      kLogTopic,
                                      kInnovationTopic,
                                      kHypothesesTopic,
                                      kLeafPosesTopic,
                                      kLeafSceneTopic}) {
    auto [schema, is_new] = schemas.try_emplace(topic.schema_name);
    if (is_new) {
      schema->second =
          writer.AddSchema(topic.schema_name, kEncoding, SchemaNamed(topic.schema_name));
    }
    channels[topic.topic] = writer.AddChannel(schema->second, topic.topic, kEncoding);
  }
  SHIFTMAP_RETURN_IF_ERROR(Write(kShiftTopic, begin, Encode(shift)));
  SHIFTMAP_RETURN_IF_ERROR(Write(kMapTopic, begin, map_message));
  std::vector<DrawnGroup> groups;
  for (const LandmarkGroup& group : map->groups()) {
    drawn.push_back(group.probabilities);
    groups.push_back({&group, &group.probabilities});
    if (groups.size() < kGroupsPerUpdate) continue;
    SHIFTMAP_RETURN_IF_ERROR(Write(kMapSceneTopic, begin, EncodeMapScene(begin, groups, {})));
    groups.clear();
  }
  return Write(kMapSceneTopic, begin, EncodeMapScene(begin, groups, map->anonymous_landmarks()));
}

Status ShiftRecorder::State::Record(const Localizer& localizer) {
  for (const PoseEstimate& estimate : localizer.new_estimates()) {
    SHIFTMAP_RETURN_IF_ERROR(RecordPose(estimate, localizer.state()));
  }
  SHIFTMAP_RETURN_IF_ERROR(RecordInnovations(localizer));
  SHIFTMAP_RETURN_IF_ERROR(RecordStates(localizer));
  const HypothesisBank* bank = localizer.hypotheses();
  if (bank == nullptr || localizer.new_estimates().empty()) return OkStatus();
  const PoseEstimate& now = localizer.new_estimates().back();
  SHIFTMAP_RETURN_IF_ERROR(RecordDecisions(localizer.decisions(), now.stamp));
  if (hypotheses_rate.Pass(now.stamp)) SHIFTMAP_RETURN_IF_ERROR(RecordHypotheses(*bank, now));
  for (const Visit& visit : bank->visits()) visited.insert(visit.group);
  return scene_rate.Pass(now.stamp) ? RecordScene(*bank, now.stamp) : OkStatus();
}

Status ShiftRecorder::State::RecordPose(const PoseEstimate& estimate, LocalizerState state) {
  if (!pose_rate.Pass(estimate.stamp)) return OkStatus();
  const Se2& T_map_vehicle = estimate.pose.T_map_vehicle;
  const live::PoseEvent event{estimate.stamp, estimate.pose, state};
  SHIFTMAP_RETURN_IF_ERROR(Write(kPoseEventTopic, estimate.stamp, Encode(event)));
  SHIFTMAP_RETURN_IF_ERROR(
      Write(kPoseTopic, estimate.stamp, EncodePoseInFrame(estimate.stamp, T_map_vehicle)));
  return Write(
      kTransformTopic, estimate.stamp, EncodeFrameTransform(estimate.stamp, T_map_vehicle));
}

Status ShiftRecorder::State::RecordInnovations(const Localizer& localizer) {
  auto next = localizer.new_innovations().begin();
  const auto end = localizer.new_innovations().end();
  for (const PoseEstimate& estimate : localizer.new_estimates()) {
    ScanInnovations scan{estimate.stamp, estimate.quality, {}};
    for (; next != end && next->stamp == estimate.stamp; ++next) {
      const ObservationOutcome& outcome = next->outcome;
      const LandmarkGroup& group = map->groups()[static_cast<std::size_t>(outcome.group)];
      scan.innovations.push_back(
          {group.signature, group.NumberOf(outcome.state), outcome.nu, outcome.S, outcome.nis});
    }
    if (scan.innovations.empty()) continue;
    SHIFTMAP_RETURN_IF_ERROR(Write(kInnovationTopic, scan.stamp, Encode(scan)));
  }
  return OkStatus();
}

Status ShiftRecorder::State::RecordStates(const Localizer& localizer) {
  const std::deque<StateChange>& changes = localizer.state_changes();
  auto first = changes.end();
  while (first != changes.begin() && !(last_state && SameChange(*(first - 1), *last_state))) {
    --first;
  }
  for (; first != changes.end(); ++first) {
    last_state = *first;
    SHIFTMAP_RETURN_IF_ERROR(Write(kStateTopic, first->stamp, Encode(*first)));
    SHIFTMAP_RETURN_IF_ERROR(Write(
        kLogTopic, first->stamp, EncodeLog(first->stamp, LevelOf(first->to), Describe(*first))));
  }
  return OkStatus();
}

Status ShiftRecorder::State::RecordDecisions(const std::vector<Decision>& standing, Stamp now) {
  const auto [before, after] = std::mismatch(
      decisions.begin(), decisions.end(), standing.begin(), standing.end(), SameDecision);
  const auto missing_in = [](std::span<const Decision> others, const Decision& decision) {
    return std::none_of(others.begin(), others.end(), [&](const Decision& other) {
      return SameDecision(other, decision);
    });
  };
  const std::span<const Decision> gone(before, decisions.end());
  const std::span<const Decision> made(after, standing.end());
  for (const Decision& decision : gone) {
    if (!missing_in(made, decision)) continue;
    SHIFTMAP_RETURN_IF_ERROR(RecordDecision({now, decision, true}));
  }
  for (const Decision& decision : made) {
    if (!missing_in(gone, decision)) continue;
    SHIFTMAP_RETURN_IF_ERROR(RecordDecision({now, decision, false}));
  }
  decisions.resize(static_cast<std::size_t>(before - decisions.begin()));
  decisions.insert(decisions.end(), after, standing.end());
  return OkStatus();
}

Status ShiftRecorder::State::RecordDecision(const DecisionChange& change) {
  SHIFTMAP_RETURN_IF_ERROR(Write(kDecisionTopic, change.stamp, Encode(change)));
  return Write(kLogTopic, change.stamp, EncodeLog(change.stamp, LogLevel::kInfo, Describe(change)));
}

Status ShiftRecorder::State::RecordHypotheses(const HypothesisBank& bank, const PoseEstimate& now) {
  HypothesesSample sample{now.stamp, ViewHypotheses(bank, *map), {}};
  std::vector<std::pair<double, Se2>> leaves;
  std::vector<Se2> poses;
  for (const Leaf* leaf : bank.leaves().all()) {
    if (poses.size() == HypothesisView::kMaxLeaves) break;
    sample.leaf_weights.push_back(std::exp(leaf->log_weight));
    poses.push_back(leaf->filter.T_map_vehicle());
    leaves.emplace_back(sample.leaf_weights.back(), poses.back());
  }
  SHIFTMAP_RETURN_IF_ERROR(Write(kHypothesesTopic, now.stamp, Encode(sample)));
  SHIFTMAP_RETURN_IF_ERROR(Write(kLeafPosesTopic, now.stamp, EncodePosesInFrame(now.stamp, poses)));
  return Write(kLeafSceneTopic, now.stamp, EncodeLeafScene(now.stamp, leaves, now.pose));
}

Status ShiftRecorder::State::RecordScene(const HypothesisBank& bank, Stamp stamp) {
  std::vector<DrawnGroup> changed;
  for (const int group : visited) {
    Eigen::VectorXd& shown = drawn[static_cast<std::size_t>(group)];
    const Eigen::VectorXd probabilities = bank.Probabilities(group);
    if ((probabilities - shown).cwiseAbs().maxCoeff() < kMinChange) continue;
    shown = probabilities;
    changed.push_back({&map->groups()[static_cast<std::size_t>(group)], &shown});
  }
  visited.clear();
  if (changed.empty()) return OkStatus();
  return Write(kMapSceneTopic, stamp, EncodeMapScene(stamp, changed, {}));
}

StatusOr<ShiftRecorder> ShiftRecorder::Create(const std::string& path,
                                              RecordedShift shift,
                                              const MapSnapshot& map,
                                              Stamp begin) {
  shift.area = map.area();
  shift.version = map.version();
  shift.content_hash = map.content_hash();
  shift.calibrated_vehicle = map.calibrated_vehicle();
  // Both are MCAP files, but a recording can be made again.
  const FileKind kind = BeginsAsRecording(path) ? FileKind::kRunLog : FileKind::kOther;
  StatusOr<AtomicFile> file = AtomicFile::Create(path, kind);
  SHIFTMAP_RETURN_IF_ERROR(AboutRecording(path, file.status()));
  auto state = std::make_unique<State>(path, *std::move(file));
  SHIFTMAP_RETURN_IF_ERROR(AboutRecording(path, state->Begin(shift, map, begin)));
  return ShiftRecorder(std::move(state));
}

ShiftRecorder::ShiftRecorder(std::unique_ptr<State> state) : state_(std::move(state)) {}
ShiftRecorder::ShiftRecorder(ShiftRecorder&&) noexcept = default;
ShiftRecorder& ShiftRecorder::operator=(ShiftRecorder&&) noexcept = default;
ShiftRecorder::~ShiftRecorder() = default;

Status ShiftRecorder::Record(const Localizer& localizer) {
  return AboutRecording(state_->path, state_->Record(localizer));
}

Status ShiftRecorder::Finish() {
  SHIFTMAP_RETURN_IF_ERROR(AboutRecording(state_->path, state_->writer.Finish()));
  return AboutRecording(state_->path, state_->file.Commit());
}

}  // namespace shiftmap
