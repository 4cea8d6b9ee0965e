// SPDX-License-Identifier: Apache-2.0
#include "mapper/cli/run_copies.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <nlohmann/json.hpp>
#include <tuple>

#include "mapstore/core/clock.h"

namespace shiftmap {
namespace {

// Of the log that a version's run was built from; nothing if its provenance does not say.
std::optional<std::int64_t> StatedObservations(const std::string& configuration,
                                               const std::string& sha256) {
  const nlohmann::json document = nlohmann::json::parse(configuration, nullptr, false);
  const auto outcome = document.find("outcome");
  if (outcome == document.end()) return std::nullopt;
  const auto logs = outcome->find("observations_of_logs");
  if (logs == outcome->end()) return std::nullopt;
  const auto count = logs->find(sha256);
  if (count == logs->end() || !count->is_number_integer()) return std::nullopt;
  return count->get<std::int64_t>();
}

}  // namespace

bool AreOfOneRun(const Run& a, const Run& b) {
  if (!a.info.uuid.empty() && !b.info.uuid.empty()) return a.info.uuid == b.info.uuid;
  const std::size_t count = std::min(a.odometry.size(), b.odometry.size());
  return a.info.vehicle == b.info.vehicle &&
         std::equal(a.odometry.begin(),
                    a.odometry.begin() + static_cast<std::ptrdiff_t>(count),
                    b.odometry.begin(),
                    [](const OdometrySample& of_a, const OdometrySample& of_b) {
                      return of_a.stamp == of_b.stamp && of_a.v_mps == of_b.v_mps &&
                             of_a.omega_radps == of_b.omega_radps;
                    });
}

std::int64_t CountObservations(const Run& run) {
  std::int64_t count = 0;
  for (const Scan& scan : run.scans) count += static_cast<std::int64_t>(scan.observations.size());
  return count;
}

bool HasFewer(const Run& a, const Run& b) {
  const auto size = [](const Run& run) {
    return std::make_tuple(
        CountObservations(run), run.scans.size(), EndOf(run), run.odometry.size());
  };
  return size(a) < size(b);
}

bool HasScansOf(const Run& whole, const Run& part) {
  const auto same = [](const Observation& a, const Observation& b) {
    return a.signature == b.signature && a.kind == b.kind && a.z == b.z && a.cov_z == b.cov_z;
  };
  auto at = whole.scans.begin();
  for (const Scan& scan : part.scans) {
    while (at != whole.scans.end() && at->stamp < scan.stamp) ++at;
    if (at == whole.scans.end() || at->stamp != scan.stamp) return false;
    auto seen = at->observations.begin();
    for (const Observation& observation : scan.observations) {
      seen = std::find_if(
          seen, at->observations.end(), [&](const auto& of) { return same(of, observation); });
      if (seen == at->observations.end()) return false;
      ++seen;
    }
    ++at;
  }
  return true;
}

StatusOr<const LineRun*> FindMappedRun(
    const std::vector<LineRun>& runs,
    const RunInfo& info,
    const std::string& sha256,
    Stamp begin,
    const std::function<StatusOr<bool>(const LineRun& run)>& is_log_of) {
  const auto find = [&](const auto& is_wanted) {
    const auto found = std::find_if(
        runs.begin(), runs.end(), [&](const LineRun& of) { return is_wanted(of.run); });
    return found == runs.end() ? nullptr : &*found;
  };
  const LineRun* const mapped = find([&](const RunRecord& run) {
    return run.sha256 == sha256 || (!info.uuid.empty() && run.uuid == info.uuid);
  });
  if (mapped != nullptr) return mapped;
  const LineRun* const like = find([&](const RunRecord& run) {
    return (info.uuid.empty() || run.uuid.empty()) && run.vehicle == info.vehicle &&
           run.begin == begin;
  });
  if (like == nullptr) return like;
  SHIFTMAP_ASSIGN_OR_RETURN(const bool is, is_log_of(*like));
  return is ? like : nullptr;
}

bool IsLogOf(const Run& run, const RunRecord& mapped, const std::vector<EvidenceRow>& rows) {
  // Nothing but a clock that was not set comes back to a time.
  const bool named = !mapped.vehicle.empty();
  if (named && mapped.begin >= kFirstPlausibleStamp && EndOf(run) == mapped.end) return true;
  const auto saw = [&](const Signature& signature, Stamp stamp) {
    const auto scan = std::lower_bound(
        run.scans.begin(), run.scans.end(), stamp, [](const Scan& of, Stamp wanted) {
          return of.stamp < wanted;
        });
    return scan != run.scans.end() && scan->stamp == stamp &&
           std::any_of(scan->observations.begin(), scan->observations.end(), [&](const auto& of) {
             return of.signature == signature;
           });
  };
  Stamp last = Stamp::min();
  for (const Scan& scan : run.scans) {
    if (!scan.observations.empty()) last = scan.stamp;
  }
  int visits = 0;
  int seen = 0;
  for (const auto& [of_source, visit, vehicle] : rows) {
    if (of_source != mapped.sha256 || visit.observations == 0 || visit.end > last) continue;
    ++visits;
    seen += saw(visit.signature, visit.begin) && saw(visit.signature, visit.end) ? 1 : 0;
  }
  return 2 * seen > visits;
}

StatusOr<std::optional<std::string>> MissingRest(const std::string& area,
                                                 const LineRun& mapped,
                                                 const Run& log,
                                                 MapStore* store) {
  // Copies of a log, and logs of one run, are of one vehicle and one time.
  if (!log.info.vehicle.empty() && !mapped.run.vehicle.empty() &&
      log.info.vehicle != mapped.run.vehicle) {
    return std::optional(fmt::format(
        "version {} has a run of vehicle '{}' with its run UUID: a recorder draws one for each log",
        mapped.version.value(),
        mapped.run.vehicle));
  }
  if (BeginOf(log) > mapped.run.end || EndOf(log) < mapped.run.begin) {
    return std::optional(fmt::format(
        "version {} has another run of its run UUID, from {} to {} UTC: a recorder draws one for "
        "each log",
        mapped.version.value(),
        FormatUtc(mapped.run.begin),
        FormatUtc(mapped.run.end)));
  }
  std::string what;
  if (EndOf(log) > mapped.run.end) {
    what = fmt::format("a shorter copy of it, which ends at {} UTC", FormatUtc(mapped.run.end));
  } else {
    SHIFTMAP_ASSIGN_OR_RETURN(const Provenance provenance,
                              store->LoadProvenance(area, mapped.version));
    const auto stated = StatedObservations(provenance.configuration, mapped.run.sha256);
    const std::int64_t observations = CountObservations(log);
    if (!stated || *stated >= observations) return std::optional<std::string>();
    what =
        fmt::format("another log of it, which has {} observations, not {}", *stated, observations);
  }
  return std::optional(
      fmt::format("version {} was built from {}; to map all of it: shiftmap-inspect rollback to "
                  "before version {}, then shiftmap-mapper build with it",
                  mapped.version.value(),
                  what,
                  mapped.version.value()));
}

}  // namespace shiftmap
