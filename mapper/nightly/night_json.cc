// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/night_json.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "mapstore/core/count_text.h"
#include "mapstore/core/inert_text.h"

namespace shiftmap {
namespace {

Json ScoreJson(const ShiftScore& score) {
  Json states = Json::object();
  for (std::size_t i = 0; i < kLocalizerStates; ++i) {
    states[ToString(static_cast<LocalizerState>(i))] = score.seconds_in_state[i];
  }
  return {{"nis_per_dof", score.nis_per_dof()},
          {"dof", score.dof},
          {"ungated", score.ungated},
          {"states", states},
          {"decisions", score.decisions},
          {"met", score.met},
          {"right", score.right}};
}

template <typename T>
Json OrNull(const std::optional<T>& value) {
  return value ? Json(*value) : Json(nullptr);
}

const char* Word(JudgedBy basis) {
  switch (basis) {
    case JudgedBy::kNothing:
      return "nothing";
    case JudgedBy::kShifts:
      return "shifts";
    case JudgedBy::kShiftsAndFolds:
      return "shifts_and_folds";
    case JudgedBy::kFolds:
      return "folds";
    case JudgedBy::kOwnShifts:
      return "own_shifts";
  }
  return "";
}

Json JudgementJson(const Judgement& judgement) {
  Json tests = Json::array();
  for (const Judgement::NamedTest& test : judgement.tests) {
    tests.push_back({{"measure", test.name},
                     {"shifts", test.result.shifts},
                     {"mean", test.result.mean},
                     {"upper_95", test.result.upper},
                     {"margin", test.result.margin},
                     {"not_worse", test.result.not_worse()}});
  }
  Json shifts = Json::array();
  for (const JudgedShift& shift : judgement.shifts) {
    shifts.push_back(
        {{"log", shift.path},
         {"run", shift.run},
         {"vehicle", shift.vehicle},
         {"in_build", shift.in_build},
         {"fold", shift.fold > 0 ? Json(shift.fold) : Json(nullptr)},
         {"before", shift.before ? ScoreJson(*shift.before) : Json(nullptr)},
         {"after", ScoreJson(shift.after)},
         {"as_calibrated_before",
          shift.as_calibrated_before ? ScoreJson(*shift.as_calibrated_before) : Json(nullptr)}});
  }
  Json suspects = Json::array();
  for (const Judgement::Suspect& suspect : judgement.suspects) {
    suspects.push_back({{"log", suspect.path}, {"reason", suspect.reason}});
  }
  return {{"against", judgement.before ? Json(judgement.before->value()) : Json(nullptr)},
          {"version", judgement.after ? Json(judgement.after->value()) : Json(nullptr)},
          {"judged_by", Word(judgement.judged_by)},
          {"cost_per_observation",
           {{"before", OrNull(judgement.cost_before)}, {"after", OrNull(judgement.cost_after)}}},
          {"landmarks_made", judgement.landmarks_made},
          {"landmarks_removed", judgement.landmarks_removed},
          {"modes_made", judgement.modes_made},
          {"modes_removed", judgement.modes_removed},
          {"modes_merged", judgement.modes_merged},
          {"moved", judgement.moved},
          {"tests", tests},
          {"worse", judgement.worse},
          {"suspects", suspects},
          {"doubts", judgement.doubts},
          {"shifts", shifts}};
}

}  // namespace

Json AreaNightJson(const AreaNight& night) {
  return {{"area", night.area},
          {"runs_new", night.runs_new},
          {"runs_again", night.runs_again},
          {"version", night.version ? Json(night.version->value()) : Json(nullptr)},
          {"published", night.published},
          {"reasons", night.reasons},
          {"content_hash", night.content_hash},
          {"held_out", night.held_out},
          {"runs_waiting", night.runs_waiting},
          {"refused_in_a_row", night.refused_in_a_row},
          {"alarm", night.alarm()},
          {"judgement", night.judgement ? JudgementJson(*night.judgement) : Json(nullptr)}};
}

Json NightJson(const NightResult& result) {
  Json areas = Json::array();
  for (const AreaNight& night : result.areas) areas.push_back(AreaNightJson(night));
  return {{"areas", areas},
          {"reports", {{"new", result.work.reports_new}, {"known", result.work.reports_known}}},
          {"left", result.work.left},
          {"logs_deleted", result.logs_deleted.size()},
          {"logs_to_delete", result.logs_to_delete}};
}

std::string NightText(const NightResult& result) {
  std::string text = fmt::format("{} new reports\n", result.work.reports_new);
  for (const AreaNight& night : result.areas) {
    const std::string area = InertLine(night.area);
    if (night.version) {
      text += fmt::format(
          "{}: version {} from {}{} is {}published\n",
          area,
          night.version->value(),
          CountText(night.runs_new, "new run"),
          night.runs_again == 0 ? "" : fmt::format(" and {} mapped again", night.runs_again),
          night.published ? "" : "not ");
    } else if (night.runs_new + night.runs_again == 0) {
      text += fmt::format("{}: nothing new\n", area);
    } else {
      text += fmt::format(
          "{}: {}{}, no version\n",
          area,
          CountText(night.runs_new, "new run"),
          night.runs_again == 0 ? "" : fmt::format(" and {} to map again", night.runs_again));
    }
  }
  if (!result.logs_deleted.empty()) {
    text += fmt::format("{} deleted\n", CountText(result.logs_deleted.size(), "log"));
  }
  for (const std::string& path : result.logs_to_delete) {
    text += fmt::format("'{}' would be deleted\n", InertLine(path));
  }
  return text;
}

}  // namespace shiftmap
