// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/rhythm_rows.h"

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <map>
#include <optional>
#include <string_view>
#include <utility>

#include "mapstore/map/chain_rhythm.h"
#include "mapstore/store/blob.h"

namespace shiftmap {
namespace {

std::string PackRates(const Eigen::MatrixXd& rates) {
  BlobWriter blob;
  for (Eigen::Index from = 0; from < rates.rows(); ++from) {
    for (Eigen::Index to = 0; to < rates.cols(); ++to) {
      if (from != to) blob.Add(rates(from, to));
    }
  }
  return blob.bytes();
}

std::optional<Eigen::MatrixXd> UnpackRates(std::string_view bytes, int states) {
  const auto count = static_cast<std::size_t>(states) * static_cast<std::size_t>(states - 1);
  if (bytes.size() != count * sizeof(double)) return std::nullopt;
  BlobReader blob(bytes);
  Eigen::MatrixXd rates = Eigen::MatrixXd::Zero(states, states);
  for (int from = 0; from < states; ++from) {
    for (int to = 0; to < states; ++to) {
      if (from != to) rates(from, to) = blob.Double();
    }
  }
  rates.diagonal() = -rates.rowwise().sum();
  return rates;
}

// The rows of a rhythm.
struct Phases {
  std::int64_t period_s = 0;
  std::vector<Eigen::MatrixXd> rates;
};

StatusOr<ModeChain> AddRhythm(const ModeChain& chain, Phases phases) {
  // A damaged one may be more nanoseconds than there are.
  constexpr std::int64_t kMostS = 1'000'000;
  const std::chrono::seconds period(std::clamp<std::int64_t>(phases.period_s, 0, kMostS));
  SHIFTMAP_ASSIGN_OR_RETURN(ChainRhythm rhythm, ChainRhythm::Make(period, std::move(phases.rates)));
  return chain.WithRhythm(std::move(rhythm));
}

}  // namespace

Status InsertRhythmRows(Database& database,
                        std::int64_t version_id,
                        const std::vector<LandmarkGroup>& groups) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare("INSERT INTO mode_rhythm (version_id, group_index, period_s, phase, rates) "
                       "VALUES (?1, ?2, ?3, ?4, ?5)"));
  for (std::size_t i = 0; i < groups.size(); ++i) {
    const ChainRhythm* const rhythm = groups[i].chain.rhythm();
    if (rhythm == nullptr) continue;
    const auto period = std::chrono::duration_cast<std::chrono::seconds>(rhythm->calendar().period);
    std::int64_t phase = 0;
    for (const Eigen::MatrixXd& rates : rhythm->rate_matrices()) {
      const std::string bytes = PackRates(rates);
      row.Bind(version_id,
               static_cast<std::int64_t>(i),
               static_cast<std::int64_t>(period.count()),
               phase++,
               BlobView{bytes});
      SHIFTMAP_RETURN_IF_ERROR(row.Execute());
    }
  }
  return OkStatus();
}

Status ReadRhythmRows(Database& database,
                      std::int64_t version_id,
                      const std::string& owner,
                      std::vector<LandmarkGroup>& groups) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement rows,
      database.Prepare("SELECT group_index, period_s, phase, rates FROM mode_rhythm "
                       "WHERE version_id = ?1 ORDER BY group_index, phase"));
  rows.Bind(version_id);
  std::map<std::int64_t, Phases> rhythms;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
    if (!row) break;
    const std::int64_t index = rows.Int64(0);
    const bool known = index >= 0 && index < std::ssize(groups);
    Phases& phases = rhythms[index];
    if (phases.rates.empty()) phases.period_s = rows.Int64(1);
    std::optional<Eigen::MatrixXd> rates;
    if (known) {
      rates = UnpackRates(rows.Blob(3), groups[static_cast<std::size_t>(index)].chain.states());
    }
    if (!rates || rows.Int64(1) != phases.period_s || rows.Int64(2) != std::ssize(phases.rates)) {
      return DataLoss("{}: phase {} of the rhythm of group {}", owner, rows.Int64(2), index);
    }
    phases.rates.push_back(*std::move(rates));
  }
  for (auto& [index, phases] : rhythms) {
    LandmarkGroup& group = groups[static_cast<std::size_t>(index)];
    StatusOr<ModeChain> chain = AddRhythm(group.chain, std::move(phases));
    if (!chain.ok()) {
      return DataLoss("{}: group '{}': {}", owner, group.signature.text(), Message(chain.status()));
    }
    group.chain = *std::move(chain);
  }
  return OkStatus();
}

}  // namespace shiftmap
