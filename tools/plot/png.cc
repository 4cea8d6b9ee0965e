// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/png.h"

#include <cairo.h>
#include <librsvg/rsvg.h>

#include <cmath>
#include <cstdint>
#include <memory>

namespace shiftmap {
namespace {

constexpr double kMaxPixels = 4e8;
constexpr double kMaxHeightPx = 32000.0;  // Of a cairo surface.

template <auto Free>
struct Deleter {
  template <typename T>
  void operator()(T* object) const {
    Free(object);
  }
};
using Handle = std::unique_ptr<RsvgHandle, Deleter<g_object_unref>>;
using Surface = std::unique_ptr<cairo_surface_t, Deleter<cairo_surface_destroy>>;
using Drawing = std::unique_ptr<cairo_t, Deleter<cairo_destroy>>;

std::string TakeMessage(GError* error) {
  std::string message = error == nullptr ? "no reason given" : error->message;
  g_clear_error(&error);
  return message;
}

cairo_status_t Append(void* out, const unsigned char* data, unsigned int size) {
  static_cast<std::string*>(out)->append(reinterpret_cast<const char*>(data), size);
  return CAIRO_STATUS_SUCCESS;
}

Status Failed(cairo_status_t status) {
  return Internal("picture: cannot draw it as PNG: {}", cairo_status_to_string(status));
}

}  // namespace

StatusOr<std::string> RenderPng(const std::string& svg, std::optional<std::int64_t> width_px) {
  GError* error = nullptr;
  const Handle handle(
      rsvg_handle_new_from_data(reinterpret_cast<const guint8*>(svg.data()), svg.size(), &error));
  if (!handle) return InvalidArgument("picture: {}", TakeMessage(error));
  double width = 0.0;
  double height = 0.0;
  if (!rsvg_handle_get_intrinsic_size_in_pixels(handle.get(), &width, &height) || !(width > 0.0)) {
    return InvalidArgument("picture: an SVG without a size");
  }
  const double scale = width_px ? static_cast<double>(*width_px) / width : 2.0;
  const double drawn_px = std::round(width * scale);
  const double height_px = std::ceil(height * scale);
  if (!(drawn_px * height_px <= kMaxPixels && height_px <= kMaxHeightPx)) {
    return InvalidArgument("picture: {:.0f} x {:.0f} pixels, at most {:.0e} in all and {:.0f} high",
                           drawn_px,
                           height_px,
                           kMaxPixels,
                           kMaxHeightPx);
  }
  const Surface surface(cairo_image_surface_create(
      CAIRO_FORMAT_RGB24, static_cast<int>(drawn_px), static_cast<int>(height_px)));
  const Drawing drawing(cairo_create(surface.get()));
  const RsvgRectangle viewport{0.0, 0.0, drawn_px, height_px};
  if (!rsvg_handle_render_document(handle.get(), drawing.get(), &viewport, &error)) {
    return Internal("picture: cannot draw it as PNG: {}", TakeMessage(error));
  }
  if (cairo_status(drawing.get()) != CAIRO_STATUS_SUCCESS) {
    return Failed(cairo_status(drawing.get()));
  }
  std::string png;
  const cairo_status_t written = cairo_surface_write_to_png_stream(surface.get(), Append, &png);
  if (written != CAIRO_STATUS_SUCCESS) return Failed(written);
  return png;
}

}  // namespace shiftmap
