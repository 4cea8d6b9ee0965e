// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

namespace shiftmap {

/// The type of the file system that a path is on, as Linux names it ("ext4", "nfs4", "fuse.sshfs").
/// @param path       Absolute, without links.
/// @param mountinfo  Text of /proc/self/mountinfo, proc(5).
/// @returns Empty if no mount point holds the path.
std::string FileSystemType(std::string_view path, std::string_view mountinfo);

/// True for file systems that other machines write to, whose locks SQLite cannot rely on.
bool IsNetworkFileSystem(std::string_view type);

/// The network file system that a file, or the folder it would be made in, is on; empty if it is a
/// local one or cannot be told.
std::string NetworkFileSystemOf(const std::string& path);

}  // namespace shiftmap
