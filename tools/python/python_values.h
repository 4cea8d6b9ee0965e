// SPDX-License-Identifier: Apache-2.0
//
// What the bindings have in common: errors, names and times, arrays.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <Eigen/Core>
#include <cstdint>
#include <exception>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "mapstore/core/stamp.h"
#include "mapstore/geometry/se2.h"
#include "proto/core/status.h"

namespace shiftmap::python {

namespace py = pybind11;

/// A Status on its way to Python, where it is a ShiftmapError. Nothing else throws it.
class StatusError : public std::exception {
 public:
  explicit StatusError(Status status) : status_(std::move(status)), text_(Message(status_)) {}

  const Status& status() const { return status_; }
  const char* what() const noexcept override { return text_.c_str(); }

 private:
  Status status_;
  std::string text_;
};

inline void ThrowIfError(const Status& status) {
  if (!status.ok()) throw StatusError(status);
}

/// Does what takes long with other threads of the interpreter running; throws an error as
/// StatusError. `work` must not touch Python.
template <typename Work>
auto WithoutGil(const Work& work) {
  auto result = [&] {
    const py::gil_scoped_release release;
    return work();
  }();
  if constexpr (std::is_same_v<decltype(result), Status>) {
    ThrowIfError(result);
  } else {
    ThrowIfError(result.status());
    return *std::move(result);
  }
}

/// Text of a store, which may be no UTF-8: such bytes become lone surrogates, as in file names.
py::str Text(const std::string& text);

/// The time of an argument: seconds since the epoch. Throws a StatusError if no stamp has it.
Stamp TakeStamp(double seconds);
std::optional<Stamp> TakeStamp(const std::optional<double>& seconds);

/// An array with one entry per item.
template <typename Value, typename Items, typename Get>
py::array_t<Value> Array(const Items& items, const Get& get) {
  py::array_t<Value> array(static_cast<py::ssize_t>(items.size()));
  auto to = array.template mutable_unchecked<1>();
  py::ssize_t i = 0;
  for (const auto& item : items) to(i++) = static_cast<Value>(get(item));
  return array;
}

/// An array of stamps: nanoseconds since the epoch, `int64`.
template <typename Items, typename Get>
py::array_t<std::int64_t> Stamps(const Items& items, const Get& get) {
  return Array<std::int64_t>(items, [&](const auto& item) { return ToNanoseconds(get(item)); });
}

/// An array of Python strings, one per item; its type is `object`, which keeps every character.
template <typename Items, typename Get>
py::array Texts(const Items& items, const Get& get) {
  py::array array(py::dtype("O"), static_cast<py::ssize_t>(items.size()));
  auto** to = static_cast<PyObject**>(array.mutable_data());
  for (const auto& item : items) {
    Py_XSETREF(*to, Text(get(item)).release().ptr());
    ++to;
  }
  return array;
}

/// An array of small matrices or vectors, shape (items, rows, columns) or (items, rows).
template <int kRows, int kColumns, typename Items, typename Get>
py::array_t<double> Matrices(const Items& items, const Get& get) {
  std::vector<py::ssize_t> shape{static_cast<py::ssize_t>(items.size()), kRows};
  if (kColumns > 1) shape.push_back(kColumns);
  py::array_t<double> array(shape);
  double* to = array.mutable_data();
  for (const auto& item : items) {
    const Eigen::Matrix<double, kRows, kColumns> value = get(item);
    for (int row = 0; row < kRows; ++row) {
      for (int column = 0; column < kColumns; ++column) *to++ = value(row, column);
    }
  }
  return array;
}

inline Eigen::Vector3d PoseVector(const Se2& pose) { return {pose.x(), pose.y(), pose.yaw()}; }

// The parts of the module.
void BindMap(py::module_* module);
void BindStore(py::module_* module);
void BindRuns(py::module_* module);

}  // namespace shiftmap::python
