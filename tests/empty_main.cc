// SPDX-License-Identifier: Apache-2.0
// The tests' precompiled header belongs to this program.

int main() { return 0; }
