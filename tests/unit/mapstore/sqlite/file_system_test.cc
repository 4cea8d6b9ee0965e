// SPDX-License-Identifier: Apache-2.0
#include "mapstore/sqlite/file_system.h"

#include <gtest/gtest.h>

namespace shiftmap::testing {
namespace {

// As Linux writes it: id, parent, device, root, mount point, options, optional fields, -, type.
constexpr const char* kMounts =
    "22 1 254:1 / / rw,relatime shared:1 - ext4 /dev/vda1 rw\n"
    "30 22 0:25 / /tmp rw,nosuid - tmpfs tmpfs rw\n"
    "41 22 0:40 / /mnt/maps rw,relatime shared:7 master:2 - nfs4 server:/maps rw,vers=4.2\n"
    "42 22 0:41 / /mnt/with\\040space rw - cifs //server/share rw\n"
    "43 41 254:1 /srv/local /mnt/maps/local rw - ext4 /dev/vda1 rw\n"
    "44 22 0:50 / /home/me/remote rw - fuse.sshfs me@host: rw\n"
    "50 22 0:60 / /over rw - nfs old:/x rw\n"
    "51 50 0:61 / /over rw - xfs /dev/vdb rw\n"
    "nonsense\n"
    "60 22 0:60 / /broken rw nothing follows\n";

TEST(FileSystemTypeTest, IsThatOfTheInnermostMount) {
  EXPECT_EQ(FileSystemType("/var/lib/maps.db", kMounts), "ext4");
  EXPECT_EQ(FileSystemType("/tmp/a.db", kMounts), "tmpfs");
  EXPECT_EQ(FileSystemType("/tmpfoo/a.db", kMounts), "ext4");
  EXPECT_EQ(FileSystemType("/mnt/maps/a.db", kMounts), "nfs4");
  EXPECT_EQ(FileSystemType("/mnt/maps/local/a.db", kMounts), "ext4");
  EXPECT_EQ(FileSystemType("/mnt/with space/a.db", kMounts), "cifs");
  EXPECT_EQ(FileSystemType("/home/me/remote/a/b.db", kMounts), "fuse.sshfs");
  // The later mount hides the earlier one.
  EXPECT_EQ(FileSystemType("/over/a.db", kMounts), "xfs");
  EXPECT_EQ(FileSystemType("/a.db", ""), "");
}

TEST(IsNetworkFileSystemTest, TellsRemoteFromLocal) {
  for (const char* type : {"nfs", "nfs4", "cifs", "smb3", "ceph", "fuse.sshfs", "fuse.glusterfs"}) {
    EXPECT_TRUE(IsNetworkFileSystem(type)) << type;
  }
  for (const char* type : {"ext4", "xfs", "btrfs", "tmpfs", "overlay", "squashfs", "fuse", ""}) {
    EXPECT_FALSE(IsNetworkFileSystem(type)) << type;
  }
}

}  // namespace
}  // namespace shiftmap::testing
