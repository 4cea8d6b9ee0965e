#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs the Debian packages into a clean Debian root, upgrades them from a version before with a
# store full of maps, boots it and runs the services, removes and purges them. Needs root, mmdebstrap,
# lintian and the network; to boot, systemd-nspawn.
# Usage: tools/packaging/test_packages.sh [BUILD_DIR]   with what is built there; else builds anew
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

version=$(sed -n 's/^project(shiftmap VERSION \([0-9.]*\).*/\1/p' CMakeLists.txt)
debs=$PWD/build/deb
root=$debs/root
build=()
[[ -z ${1:-} ]] || build=(--build "$1")
export DEB_BUILD_OPTIONS=noautodbgsym

fail() {
  echo "packages: $*" >&2
  exit 1
}

rm -rf "$debs"
mkdir -p "$debs"
tools/packaging/deb.sh "${build[@]}" --version 0.0.1 >"$debs/old.log" 2>&1 || fail "the build failed: $debs/old.log"
tools/packaging/deb.sh "${build[@]}" >"$debs/new.log" 2>&1 || fail "the build failed: $debs/new.log"
lintian --fail-on warning,error "$debs/shiftmap_${version}_$(dpkg --print-architecture).changes"

# The root has the machine's package sources, and what is installed is removed with it.
in_root() { chroot "$root" env DEBIAN_FRONTEND=noninteractive LC_ALL=C.UTF-8 "$@"; }
trap 'rm -rf "$root" "$debs/root.tar" "$debs/image"' EXIT
mmdebstrap --quiet --variant=apt --include=adduser,systemd-sysv bookworm "$root" >"$debs/root.log" 2>&1 || fail "no root: $debs/root.log"
tar --create --file="$debs/root.tar" --directory="$root" .
mkdir "$root/debs"
cp "$debs"/*.deb "$root/debs/"

packages=(shiftmap-common shiftmap-server shiftmap-mapper shiftmap-localizer shiftmap-transfer shiftmap-inspect
  shiftmap-tools python3-shiftmap shiftmap-doc)
in_root apt-get update -qq
files_of() { printf "/debs/%s_$1_*.deb " "${packages[@]}"; }
install() { in_root bash -c "apt-get install -y -qq --no-install-recommends $(files_of "$1")" >>"$debs/root.log" 2>&1; }

install 0.0.1 || fail "cannot be installed: $debs/root.log"
as_site() { in_root setpriv --reuid shiftmap --regid shiftmap --clear-groups "$@"; }

# A site at work: maps, and an operator's word in the site file.
as_site shiftmap-sim open /tmp/world --shifts 3 --groups 8 --modes 2 --size-m 20 --seed 7 >/dev/null
as_site shiftmap-mapper build --quiet --area floor /tmp/world/run_000.mcap /tmp/world/run_001.mcap >/dev/null
echo 'log-level = "warning"' >>"$root/etc/shiftmap/shiftmap.toml"
before=$(in_root shiftmap-inspect show --area floor --at 1767945900 --json | sha256sum)

install "$version" || fail "cannot be upgraded: $debs/root.log"
after=$(in_root shiftmap-inspect show --area floor --at 1767945900 --json | sha256sum)
[[ $before == "$after" ]] || fail "the upgrade changed the map"
grep -q '^log-level = "warning"' "$root/etc/shiftmap/shiftmap.toml" || fail "the upgrade changed the site file"
in_root shiftmap-inspect verify --quiet >/dev/null || fail "the store does not verify after the upgrade"
as_site shiftmap-mapper build --quiet --area floor /tmp/world/run_002.mcap >/dev/null || fail "no build after the upgrade"
in_root python3 -c 'import shiftmap; print(len(shiftmap.Store("/var/lib/shiftmap/maps.db").load("floor").signatures))' >/dev/null

# The localizer is for vehicles: no Ceres.
! in_root ldd /usr/bin/shiftmap-localizer | grep -E 'ceres|grpc' || fail "the localizer links what a vehicle has no use for"
for page in shiftmap-inspect shiftmap-mapper-build shiftmap-localizer-serve; do
  [[ -s $root/usr/share/man/man1/$page.1.gz ]] || fail "no manual page $page"
done
# What the operations guide starts with, and links.
"$root/usr/share/doc/shiftmap-server/examples/certificates.sh" init "$debs/authority" >>"$debs/root.log" 2>&1 ||
  fail "certificates.sh does not run: $debs/root.log"
while read -r link; do
  [[ -e $root/usr/share/doc/shiftmap/tools/$link ]] || fail "the operations guide links '$link', which no package has"
done < <(grep -oE '\]\([^)#:]+' tools/OPERATIONS.md | cut --characters=3-)
for example in shiftmap-localizer/examples/vda5050_client.py shiftmap-server/examples/fetch_and_submit.py; do
  in_root python3 -c 'import ast, sys; ast.parse(open(sys.argv[1]).read())' "/usr/share/doc/$example" || fail "no example $example"
done
in_root bash -c 'source /usr/share/bash-completion/completions/shiftmap-inspect && complete -p shiftmap-inspect' >/dev/null

mkdir "$debs/image"
cp "$debs"/*_"${version}"_*.deb "$debs/image"
tools/packaging/test_container.sh "$debs/root.tar" "$debs/image" "$root/tmp/world" "$debs/image.log" ||
  fail "the image does not work: $debs/image.log"

tools/packaging/boot_services.sh "$root" "$debs/boot.log" || fail "the services do not run: $debs/boot.log"

in_root apt-get remove -y -qq "${packages[@]}" >>"$debs/root.log" 2>&1 || fail "cannot be removed: $debs/root.log"
[[ -s $root/var/lib/shiftmap/maps.db ]] || fail "removing the packages removed the maps"
in_root dpkg --purge "${packages[@]}" >>"$debs/root.log" 2>&1 || fail "cannot be purged: $debs/root.log"
[[ -s $root/var/lib/shiftmap/maps.db ]] || fail "purging the packages removed the maps"
left=$(find "$root/usr" "$root/etc" "$root/lib/systemd" -name '*shiftmap*' ! -path '*/debs/*' ! -name 'shiftmap*.list' || true)
[[ -z $left ]] || fail "purging left $left"
echo "packages: built, lintian clean, installed, upgraded with a map, removed and purged"
