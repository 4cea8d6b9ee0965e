// SPDX-License-Identifier: Apache-2.0
//
// The extension module behind the Python package: errors and what all parts share.
#include <cmath>
#include <exception>
#include <utility>

#include "mapstore/cli/exit_codes.h"
#include "mapstore/cli/version.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/core/stamp_check.h"
#include "tools/python/python_values.h"

namespace shiftmap::python {
namespace {

const char* CategoryOf(ExitCode code) {
  switch (code) {
    case ExitCode::kBadInput:
      return "bad_input";
    case ExitCode::kConflict:
      return "conflict";
    case ExitCode::kNothingToDo:
      return "nothing_to_do";
    case ExitCode::kNotFound:
      return "not_found";
    case ExitCode::kTemporary:
      return "temporary";
    default:
      return "internal";
  }
}

// Lives as long as the interpreter.
PyObject* error_class = nullptr;

void SetError(const Status& status) {
  const ExitCode code = ExitCodeFor(status);
  py::object error = py::handle(error_class)(Text(InertLine(Message(status))));
  error.attr("category") = CategoryOf(code);
  error.attr("exit_code") = static_cast<int>(code);
  PyErr_SetObject(error_class, error.ptr());
}

void BindErrors(py::module_* module) {
  error_class = PyErr_NewExceptionWithDoc(
      "shiftmap.ShiftmapError",
      "What went wrong, in one line. `category` is 'bad_input' (do not retry), 'not_found', "
      "'conflict', 'nothing_to_do', 'temporary' (retry) or 'internal'; `exit_code` is what a "
      "command would exit with.",
      nullptr,
      nullptr);
  module->attr("ShiftmapError") = py::handle(error_class);
  py::register_exception_translator([](std::exception_ptr error) {
    try {
      if (error) std::rethrow_exception(std::move(error));
    } catch (const StatusError& caught) {
      SetError(caught.status());
    }
  });
}

}  // namespace

py::str Text(const std::string& text) {
  PyObject* decoded =
      PyUnicode_DecodeUTF8(text.data(), static_cast<Py_ssize_t>(text.size()), "surrogateescape");
  if (decoded == nullptr) throw py::error_already_set();
  return py::reinterpret_steal<py::str>(decoded);
}

Stamp TakeStamp(double seconds) {
  constexpr double kMaxSeconds = 9.2e9;
  if (!(std::abs(seconds) <= kMaxSeconds)) {
    throw StatusError(InvalidArgument("time {}, expected seconds since the epoch", seconds));
  }
  const Stamp stamp = StampFromSeconds(seconds);
  ThrowIfError(ValidateStamp(stamp));
  return stamp;
}

std::optional<Stamp> TakeStamp(const std::optional<double>& seconds) {
  if (!seconds) return std::nullopt;
  return TakeStamp(*seconds);
}

}  // namespace shiftmap::python

PYBIND11_MODULE(_native, module) {
  module.doc() = "Maps of places whose landmarks move: see the package shiftmap.";
  module.attr("__version__") = shiftmap::SoftwareVersion();
  shiftmap::python::BindErrors(&module);
  shiftmap::python::BindMap(&module);
  shiftmap::python::BindStore(&module);
  shiftmap::python::BindRuns(&module);
}
