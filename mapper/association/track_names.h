// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>

#include "mapper/association/anonymous_tracks.h"
#include "mapstore/core/ids.h"
#include "mapstore/map/calibration.h"
#include "mapstore/run/run.h"
#include "proto/core/status.h"

namespace shiftmap {

/// The name that a track goes by while a map is built: "anon:<run>:<track>", with leading zeros so
/// that names sort as numbers do. No map has such a signature.
Signature TrackSignature(int run, int track);

/// Whether a signature is one that TrackSignature() makes, or could.
bool IsTrackSignature(const Signature& signature);

/// Gives each anonymous observation that AssociateAnonymous() finds a track for the name of that
/// track; others stay anonymous, and all do where fewer than `min_associated_share` have one. From
/// there on the run is like one with signatures.
/// @param number  Of the run in the build.
/// @param on_step  As AssociateAnonymous(); may be empty.
/// Errors: kInvalidArgument if the run has a signature that begins like a track's name.
Status NameTracks(int number,
                  const Calibration& calibration,
                  const AssociationOptions& options,
                  const FrontEndOptions& front_end,
                  const std::function<bool()>& on_step,
                  Run* run);

}  // namespace shiftmap
