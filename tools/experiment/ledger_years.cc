// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/ledger_years.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>
#include <utility>

#include "mapper/chain/group_chains.h"
#include "mapstore/core/day.h"
#include "mapstore/maintenance/compact.h"
#include "mapstore/map_store.h"
#include "tools/experiment/dice.h"
#include "tools/experiment/processor_time.h"

namespace shiftmap {
namespace {

constexpr char kArea[] = "site";
constexpr int kDaysOfYear = 365;
constexpr double kStartS = 9.5e8;
constexpr int kModes = 2;

Stamp At(double day) { return StampFromSeconds(kStartS + kSecondsPerDay * day); }

// A landmark that moves to and fro between its modes, and is away now and then.
struct Landmark {
  double stay_days = 0.0;  // 0: for ever.
  double until_day = 0.0;
  int state = 1;
};

MapContent MakeMap(int groups) {
  MapContent content;
  content.stamp = At(0.0);
  for (int i = 0; i < groups; ++i) {
    LandmarkGroup group;
    group.signature = Signature(fmt::format("L{:05}", i));
    for (int mode = 1; mode <= kModes; ++mode) {
      group.modes.push_back({ModeNumber(mode),
                             {static_cast<double>(i), static_cast<double>(mode)},
                             1e-4 * Eigen::Matrix2d::Identity(),
                             content.stamp});
    }
    group.chain = ModeChain::Uniform(kModes, GroupChainOptions().leave_rate_per_s);
    group.probabilities = group.chain.stationary();
    content.groups.push_back(std::move(group));
  }
  const std::size_t modes = static_cast<std::size_t>(groups) * kModes;
  content.covariance =
      JointCovariance(std::vector<Eigen::Matrix2d>(modes, 1e-4 * Eigen::Matrix2d::Identity()), {});
  return content;
}

class Site {
 public:
  Site(const LedgerYearsOptions& options, std::string path)
      : options_(options), path_(std::move(path)), dice_(options.seed) {
    for (int i = 0; i < options.groups; ++i) {
      Landmark& landmark = landmarks_.emplace_back();
      const int kind = i % 4;
      if (kind != 0) landmark.stay_days = options.stay_days * (kind == 1 ? 0.1 : 1.0);
      landmark.until_day = Stay(landmark);
    }
  }

  Status Start() {
    SHIFTMAP_RETURN_IF_ERROR(Open());
    SHIFTMAP_RETURN_IF_ERROR(store_->Commit(kArea, MakeMap(options_.groups), {}, {}).status());
    SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, store_->LoadAt(kArea));
    version_ = map.version();
    content_hash_ = map.content_hash();
    groups_ = map.groups();
    return OkStatus();
  }

  // The reports of a day.
  Status DriveDay(int day, LedgerYear* year) {
    std::vector<ShiftReport> reports(static_cast<std::size_t>(options_.vehicles));
    for (std::size_t vehicle = 0; vehicle < reports.size(); ++vehicle) {
      ShiftReport& report = reports[vehicle];
      report.uuid = fmt::format("{:08x}-0000-4000-8000-{:012x}", day, vehicle);
      report.vehicle = fmt::format("truck {}", vehicle);
      report.area = kArea;
      report.version = *version_;
      report.content_hash = content_hash_;
      report.software = "shiftmap-experiment";
      report.begin = At(day);
      report.end = At(day + 1.0);
    }
    for (std::size_t i = 0; i < landmarks_.size(); ++i) {
      std::vector<double> times;
      for (int k = dice_.Poisson(options_.visits_per_day); k > 0; --k)
        times.push_back(day + dice_.Uniform(0.0, 0.999));
      std::sort(times.begin(), times.end());
      for (const double time : times) {
        const auto vehicle = static_cast<std::size_t>(dice_.Uniform(0.0, options_.vehicles));
        reports[vehicle].evidence.push_back(See(i, time));
        year->visits += 1.0;
      }
    }
    for (const ShiftReport& report : reports) {
      const double begin_s = ThreadProcessorSeconds();
      SHIFTMAP_RETURN_IF_ERROR(store_->Return(report).status());
      year->return_s += ThreadProcessorSeconds() - begin_s;
    }
    return OkStatus();
  }

  // A build that finds nothing new, but the rates.
  Status LearnRates(int day) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<EvidenceRow> rows,
                              store_->Evidence(kArea, *version_));
    SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, store_->LoadAt(kArea));
    SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<GroupChain> chains,
                              LearnGroupChains(map.groups(), rows, {}));
    MapContent content = map.content();
    for (std::size_t i = 0; i < chains.size(); ++i) {
      content.groups[i].chain = chains[i].chain.chain;
    }
    content.stamp = At(day);
    CommitOptions commit;
    commit.parent = version_;
    commit.states_probabilities = false;
    SHIFTMAP_ASSIGN_OR_RETURN(const CommitResult committed,
                              store_->Commit(kArea, content, {}, commit));
    version_ = committed.version;
    content_hash_ = committed.content_hash;
    return OkStatus();
  }

  Status Compact(int day, LedgerYear* year) {
    store_.reset();
    RetentionPolicy policy;
    policy.thin_before = At(day - options_.keep_days);
    const double begin_s = ThreadProcessorSeconds();
    SHIFTMAP_RETURN_IF_ERROR(CompactStore(path_, policy, false).status());
    year->compact_s += ThreadProcessorSeconds() - begin_s;
    return Open();
  }

  Status Measure(int day, LedgerYear* year) {
    std::error_code error;
    constexpr double kMib = 1024.0 * 1024.0;
    year->store_mib = static_cast<double>(std::filesystem::file_size(path_, error)) / kMib;
    SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<ReportSummary> reports, store_->Reports(kArea));
    for (const ReportSummary& report : reports) year->rows += report.evidence_rows;
    constexpr int kLoads = 10;
    double begin_s = ThreadProcessorSeconds();
    for (int i = 0; i < kLoads; ++i) SHIFTMAP_RETURN_IF_ERROR(store_->LoadAt(kArea).status());
    year->load_s = (ThreadProcessorSeconds() - begin_s) / kLoads;
    begin_s = ThreadProcessorSeconds();
    SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<EvidenceRow> rows,
                              store_->Evidence(kArea, *version_));
    year->evidence_s = ThreadProcessorSeconds() - begin_s;
    begin_s = ThreadProcessorSeconds();
    SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<GroupChain> chains,
                              LearnGroupChains(groups_, rows, {}));
    year->fit_s = ThreadProcessorSeconds() - begin_s;
    for (const GroupChain& chain : chains) {
      if (chain.learned) year->rates.push_back(chain.chain.leave.rate_per_s);
    }
    constexpr int kTimes = 20;
    for (int i = 1; i <= kTimes; ++i) {
      const double time = day - kDaysOfYear * (1.0 - static_cast<double>(i) / kTimes);
      SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map,
                                store_->LoadAt(kArea, std::nullopt, At(time)));
      for (const LandmarkGroup& group : map.groups()) {
        year->probabilities.push_back(group.probabilities(1));
      }
    }
    return OkStatus();
  }

 private:
  Status Open() {
    SHIFTMAP_ASSIGN_OR_RETURN(MapStore store,
                              MapStore::Open(path_, MapStore::Access::kReadWriteCreate));
    store_.emplace(std::move(store));
    return OkStatus();
  }

  double Stay(const Landmark& landmark) {
    if (!(landmark.stay_days > 0.0)) return 1e9;
    return -landmark.stay_days * std::log(1.0 - dice_.Uniform(0.0, 1.0));
  }

  VisitEvidence See(std::size_t index, double time) {
    Landmark& landmark = landmarks_[index];
    while (landmark.until_day < time) {
      const int other = landmark.state == 0 ? 1 + (dice_.Coin(0.5) ? 1 : 0) : 3 - landmark.state;
      landmark.state = landmark.state != 0 && dice_.Coin(0.1) ? 0 : other;
      landmark.until_day += Stay(landmark);
    }
    constexpr double kSureNats = 20.0;
    VisitEvidence visit{groups_[index].signature, At(time), At(time) + FromSeconds(20.0), {}, 0};
    visit.observations = landmark.state == 0 ? 0 : 40;
    for (int state = 0; state <= kModes; ++state) {
      visit.modes.push_back({ModeNumber(state), state == landmark.state ? 0.0 : -kSureNats});
    }
    return visit;
  }

  LedgerYearsOptions options_;
  std::string path_;
  Dice dice_;
  std::vector<Landmark> landmarks_;
  std::optional<MapStore> store_;
  std::optional<VersionNumber> version_;
  std::string content_hash_;
  std::vector<LandmarkGroup> groups_;
};

}  // namespace

StatusOr<std::vector<LedgerYear>> RunLedgerYears(const LedgerYearsOptions& options,
                                                 const std::string& path,
                                                 const std::function<void(double)>& progress) {
  std::error_code error;
  if (std::filesystem::exists(path, error)) {
    return FailedPrecondition("store '{}': is there already", path);
  }
  Site site(options, path);
  SHIFTMAP_RETURN_IF_ERROR(site.Start());
  std::vector<LedgerYear> years;
  double visits = 0.0;
  double next_build = options.build_days;
  for (int number = 1; number <= options.years; ++number) {
    LedgerYear year;
    year.year = number;
    year.visits = visits;
    for (int day = (number - 1) * kDaysOfYear; day < number * kDaysOfYear; ++day) {
      SHIFTMAP_RETURN_IF_ERROR(site.DriveDay(day, &year));
      if (day + 1 >= next_build) {
        SHIFTMAP_RETURN_IF_ERROR(site.LearnRates(day + 1));
        if (options.compacts) SHIFTMAP_RETURN_IF_ERROR(site.Compact(day + 1, &year));
        next_build += options.build_days;
      }
      progress((day + 1.0) / (options.years * kDaysOfYear));
    }
    visits = year.visits;
    SHIFTMAP_RETURN_IF_ERROR(site.Measure(number * kDaysOfYear, &year));
    years.push_back(std::move(year));
  }
  return years;
}

}  // namespace shiftmap
