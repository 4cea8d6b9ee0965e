// SPDX-License-Identifier: Apache-2.0
//
// The programs that read one site file, their commands, and the keys that they share.
#pragma once

#include <string>
#include <vector>

namespace shiftmap {

/// A program and its commands, for the tables of a site file.
struct ProgramCommands {
  std::string program;                ///< Without `shiftmap-`; names a table.
  std::vector<std::string> commands;  ///< Name tables too.
};

/// All programs of this project. A test holds it against the programs themselves.
const std::vector<ProgramCommands>& AllPrograms();

/// Keys that mean the same to every program that has an option of this name: they may stand at the
/// top of a site file, whoever reads it.
const std::vector<std::string>& SharedKeys();

/// Whether a command takes a key from its own table of the site file alone: neither from the top,
/// where it is meant for other commands, nor from the environment. So no night is kept from an
/// area.
bool IsOfOwnTable(const std::string& command, const std::string& key);

/// The environment variable that has the value of a shared key, `SHIFTMAP_STORE` for `store`; empty
/// for any other key.
std::string EnvironmentNameOf(const std::string& key);

}  // namespace shiftmap
