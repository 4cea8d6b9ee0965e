// SPDX-License-Identifier: Apache-2.0
#include "mapstore/sqlite/file_system.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <vector>

namespace shiftmap {
namespace {

constexpr std::array<std::string_view, 23> kNetworkTypes = {
    "afs",         "beegfs",       "ceph",           "cifs",
    "coda",        "davfs",        "fuse.ceph",      "fuse.ceph-fuse",
    "fuse.davfs2", "fuse.gcsfuse", "fuse.glusterfs", "fuse.juicefs",
    "fuse.rclone", "fuse.s3fs",    "fuse.smbnetfs",  "fuse.sshfs",
    "gpfs",        "lustre",       "ncpfs",          "nfs",
    "nfs4",        "smb3",         "smbfs"};

std::vector<std::string_view> Split(std::string_view text, char separator) {
  std::vector<std::string_view> parts;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find(separator), text.size());
    if (end > 0) parts.push_back(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return parts;
}

bool IsOctal(char c) { return c >= '0' && c <= '7'; }

// Spaces and the like are written as \ and three octal digits.
std::string Unescaped(std::string_view text) {
  std::string plain;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '\\' && i + 3 < text.size() && IsOctal(text[i + 1]) && IsOctal(text[i + 2]) &&
        IsOctal(text[i + 3])) {
      plain += static_cast<char>((text[i + 1] - '0') * 64 + (text[i + 2] - '0') * 8 +
                                 (text[i + 3] - '0'));
      i += 3;
    } else {
      plain += text[i];
    }
  }
  return plain;
}

bool Holds(std::string_view mount_point, std::string_view path) {
  if (mount_point == "/") return true;
  return path.substr(0, mount_point.size()) == mount_point &&
         (path.size() == mount_point.size() || path[mount_point.size()] == '/');
}

}  // namespace

std::string FileSystemType(std::string_view path, std::string_view mountinfo) {
  std::string type;
  std::size_t longest = 0;
  for (const std::string_view line : Split(mountinfo, '\n')) {
    const std::vector<std::string_view> fields = Split(line, ' ');
    const auto separator = std::find(fields.begin(), fields.end(), "-");
    if (fields.size() < 6 || separator == fields.end() || separator + 1 == fields.end()) continue;
    const std::string mount_point = Unescaped(fields[4]);
    // Of several mounts on one point the last hides the others.
    if (!Holds(mount_point, path) || mount_point.size() < longest) continue;
    longest = mount_point.size();
    type = *(separator + 1);
  }
  return type;
}

bool IsNetworkFileSystem(std::string_view type) {
  return std::find(kNetworkTypes.begin(), kNetworkTypes.end(), type) != kNetworkTypes.end();
}

std::string NetworkFileSystemOf(const std::string& path) {
  std::error_code error;
  const std::filesystem::path real =
      std::filesystem::weakly_canonical(std::filesystem::absolute(path, error), error);
  if (error) return "";
  std::ifstream file("/proc/self/mountinfo");
  const std::string text((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  std::string type = FileSystemType(real.string(), text);
  return IsNetworkFileSystem(type) ? type : "";
}

}  // namespace shiftmap
