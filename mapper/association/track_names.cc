// SPDX-License-Identifier: Apache-2.0
#include "mapper/association/track_names.h"

namespace shiftmap {
namespace {

constexpr const char* kPrefix = "anon:";

}  // namespace

Signature TrackSignature(int run, int track) {
  return Signature(fmt::format("{}{:06}:{:06}", kPrefix, run, track));
}

bool IsTrackSignature(const Signature& signature) { return signature.text().starts_with(kPrefix); }

Status NameTracks(int number,
                  const Calibration& calibration,
                  const AssociationOptions& options,
                  const FrontEndOptions& front_end,
                  const std::function<bool()>& on_step,
                  Run* run) {
  for (const Scan& scan : run->scans) {
    for (const Observation& observation : scan.observations) {
      if (!IsTrackSignature(observation.signature)) continue;
      return InvalidArgument("signature '{}': begins with '{}', which is reserved",
                             observation.signature.text(),
                             kPrefix);
    }
  }
  const AnonymousAssociation found =
      AssociateAnonymous(*run, calibration, options, front_end, on_step);
  if (found.associated < options.min_associated_share * found.observations) return OkStatus();
  for (std::size_t i = 0; i < run->scans.size(); ++i) {
    for (std::size_t j = 0; j < run->scans[i].observations.size(); ++j) {
      const int track = found.track_of[i][j];
      if (track >= 0) run->scans[i].observations[j].signature = TrackSignature(number, track);
    }
  }
  return OkStatus();
}

}  // namespace shiftmap
