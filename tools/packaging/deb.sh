#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds the Debian packages into build/deb.
# Usage: tools/packaging/deb.sh [--build DIR] [--version V]
#   --build DIR   take the programs that are built there, instead of building them anew
#   --version V   another version than the project's, for tests of upgrades
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

version=$(sed -n 's/^project(shiftmap VERSION \([0-9.]*\).*/\1/p' CMakeLists.txt)
unset SHIFTMAP_BUILD
while (($# > 0)); do
  case $1 in
    --build) SHIFTMAP_BUILD=$(realpath "$2") ;;
    --version) version=$2 ;;
    *) sed -n '3,7s/^# //p' "${BASH_SOURCE[0]}" >&2 && exit 2 ;;
  esac
  shift 2
done
[[ -z ${SHIFTMAP_BUILD:-} ]] || export SHIFTMAP_BUILD

source=build/deb/shiftmap-$version
rm -rf "$source"
mkdir -p "$source"
git ls-files --cached --others --exclude-standard | tar --create --files-from=- | tar --extract --directory="$source"
mv "$source/tools/packaging/debian" "$source/debian"
# The files' times are the last commit's, so that the same source gives the same packages.
export SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct)}
cat >"$source/debian/changelog" <<END
shiftmap ($version) unstable; urgency=medium

  * Version $version.

 -- shiftmap maintainers <maintainers@shiftmap.invalid>  $(date --utc --rfc-email --date="@$SOURCE_DATE_EPOCH")
END
cd "$source"
dpkg-buildpackage --build=binary --no-sign --jobs="$(nproc)"
