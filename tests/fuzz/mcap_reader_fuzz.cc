// SPDX-License-Identifier: Apache-2.0
//
// Reads the input as the records behind an MCAP file's magic. Whatever they are, reading must end,
// give data that can be touched, and stay at its end.
#include <sstream>
#include <string>

#include "proto/core/check.h"
#include "proto/mcap/crc32.h"
#include "proto/mcap/format.h"
#include "proto/mcap/reader.h"

extern "C" int LLVMFuzzerTestOneInput(const unsigned char* bytes, std::size_t size) {
  using shiftmap::mcap::Reader;
  std::istringstream in(std::string(shiftmap::mcap::kMagic) +
                        std::string(reinterpret_cast<const char*>(bytes), size));
  auto reader = Reader::Open(&in);
  SHIFTMAP_CHECK(reader.ok(), "{}", shiftmap::Message(reader.status()));
  shiftmap::mcap::Crc32 touched;
  for (;;) {
    const auto message = reader->Next();
    if (!message.ok() || !message->has_value()) break;
    touched.Update((*message)->data);
    touched.Update((*message)->channel->topic);
  }
  const auto after = reader->Next();
  SHIFTMAP_CHECK(after.ok() && !after->has_value(), "goes on after its end");
  return 0;
}
