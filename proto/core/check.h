// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>

#include <cstdio>
#include <cstdlib>

/// Aborts with values when a caller broke a contract. Never for input: input gets a Status.
#define SHIFTMAP_CHECK(condition, ...)                        \
  do {                                                        \
    if (!(condition)) [[unlikely]] {                          \
      std::fputs(fmt::format("{}:{}: check failed: {}: {}\n", \
                             __FILE__,                        \
                             __LINE__,                        \
                             #condition,                      \
                             fmt::format(__VA_ARGS__))        \
                     .c_str(),                                \
                 stderr);                                     \
      std::abort();                                           \
    }                                                         \
  } while (false)
