// SPDX-License-Identifier: Apache-2.0
//
// The one header behind which the error type stands. Nothing else includes absl.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <fmt/format.h>

#include <string>
#include <utility>

namespace shiftmap {

/// The result of a fallible operation. Codes and what they mean here (and the exit code a command
/// gives them):
///
///   kInvalidArgument     the input is wrong and will stay wrong: bad file, bad value        (3)
///   kDataLoss            the input is damaged: truncated, checksum mismatch                  (3)
///   kFailedPrecondition  the input is of another kind or a newer schema than this build reads (3)
///   kPermissionDenied, kUnauthenticated, kUnimplemented  a map server refuses it          (3)
///   kAborted             the published version moved in between: plan again                  (4)
///   kAlreadyExists       nothing to do                                                       (5)
///   kNotFound            no such file, area, version                                         (6)
///   kUnavailable         busy or full now, may work later                                   (75)
///   kInternal            a bug of ours                                                      (70)
using absl::OkStatus;
using absl::Status;
using absl::StatusCode;
using absl::StatusOr;

/// Returns a status with a message built by fmt. Messages are lower case and name what, which
/// object, got and expected: `map 'a.db': schema version 7, this build reads 1..5`.
template <typename... Args>
[[nodiscard]] Status MakeStatus(StatusCode code,
                                fmt::format_string<Args...> format,
                                Args&&... args) {
  return Status(code, fmt::format(format, std::forward<Args>(args)...));
}

template <typename... Args>
[[nodiscard]] Status InvalidArgument(fmt::format_string<Args...> format, Args&&... args) {
  return MakeStatus(StatusCode::kInvalidArgument, format, std::forward<Args>(args)...);
}

template <typename... Args>
[[nodiscard]] Status NotFound(fmt::format_string<Args...> format, Args&&... args) {
  return MakeStatus(StatusCode::kNotFound, format, std::forward<Args>(args)...);
}

template <typename... Args>
[[nodiscard]] Status DataLoss(fmt::format_string<Args...> format, Args&&... args) {
  return MakeStatus(StatusCode::kDataLoss, format, std::forward<Args>(args)...);
}

template <typename... Args>
[[nodiscard]] Status FailedPrecondition(fmt::format_string<Args...> format, Args&&... args) {
  return MakeStatus(StatusCode::kFailedPrecondition, format, std::forward<Args>(args)...);
}

template <typename... Args>
[[nodiscard]] Status Unavailable(fmt::format_string<Args...> format, Args&&... args) {
  return MakeStatus(StatusCode::kUnavailable, format, std::forward<Args>(args)...);
}

template <typename... Args>
[[nodiscard]] Status Internal(fmt::format_string<Args...> format, Args&&... args) {
  return MakeStatus(StatusCode::kInternal, format, std::forward<Args>(args)...);
}

/// The message of a status as a std::string (Debian's absl::string_view is not std::string_view).
inline std::string Message(const Status& status) {
  return std::string(status.message().data(), status.message().size());
}

/// The status with "<what>: " before its message; OK stays OK.
template <typename... Args>
[[nodiscard]] Status Annotate(const Status& status,
                              fmt::format_string<Args...> what,
                              Args&&... args) {
  if (status.ok()) return status;
  return MakeStatus(
      status.code(), "{}: {}", fmt::format(what, std::forward<Args>(args)...), Message(status));
}

}  // namespace shiftmap

/// Returns from the enclosing function if `expr`, a Status, is not OK.
#define SHIFTMAP_RETURN_IF_ERROR(expr)                                          \
  do {                                                                          \
    if (::shiftmap::Status shiftmap_status_ = (expr); !shiftmap_status_.ok()) { \
      return shiftmap_status_;                                                  \
    }                                                                           \
  } while (false)

#define SHIFTMAP_CONCAT_INNER_(a, b) a##b
#define SHIFTMAP_CONCAT_(a, b) SHIFTMAP_CONCAT_INNER_(a, b)
#define SHIFTMAP_ASSIGN_OR_RETURN_INNER_(result, lhs, expr) \
  auto result = (expr);                                     \
  if (!result.ok()) {                                       \
    return result.status();                                 \
  }                                                         \
  lhs = *std::move(result)

/// Evaluates `expr`, a StatusOr<T>; assigns its value to `lhs` or returns its status.
#define SHIFTMAP_ASSIGN_OR_RETURN(lhs, expr) \
  SHIFTMAP_ASSIGN_OR_RETURN_INNER_(SHIFTMAP_CONCAT_(shiftmap_result_, __LINE__), lhs, expr)
