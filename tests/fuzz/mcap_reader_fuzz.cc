// SPDX-License-Identifier: Apache-2.0
//
// Reads the input as the records behind an MCAP file's magic. Whatever they are, reading must end,
// give data that can be touched, and stay at its end.
#include <sstream>

#include "proto/core/check.h"
#include "proto/mcap/crc32.h"
#include "proto/mcap/format.h"
#include "proto/mcap/reader.h"
#include "proto/mcap/writer.h"
#include "tests/fuzz/fuzz_target.h"

namespace shiftmap::testing {

std::vector<std::string> FuzzSeeds() {
  std::vector<std::string> seeds = {""};
  for (const auto compression : {mcap::Compression::kNone, mcap::Compression::kZstd}) {
    std::string bytes;
    mcap::Writer writer(
        [&](std::string_view more) {
          bytes += more;
          return OkStatus();
        },
        {.compression = compression, .chunk_bytes = 200});
    const auto channel = writer.AddChannel(writer.AddSchema("s", "raw", "data"), "/t", "raw");
    for (std::uint64_t i = 0; i < 4; ++i) {
      SHIFTMAP_CHECK(writer.Write(channel, i, std::string(100, 'x')).ok(), "message {}", i);
    }
    SHIFTMAP_CHECK(writer.Finish().ok(), "seed");
    seeds.push_back(bytes.substr(mcap::kMagic.size()));
  }
  return seeds;
}

void RunFuzzInput(std::string_view bytes) {
  std::istringstream in(std::string(mcap::kMagic) + std::string(bytes));
  auto reader = mcap::Reader::Open(&in);
  SHIFTMAP_CHECK(reader.ok(), "{}", Message(reader.status()));
  mcap::Crc32 touched;
  for (;;) {
    const auto message = reader->Next();
    if (!message.ok() || !message->has_value()) break;
    touched.Update((*message)->data);
    touched.Update((*message)->channel->topic);
  }
  const auto after = reader->Next();
  SHIFTMAP_CHECK(after.ok() && !after->has_value(), "goes on after its end");
}

}  // namespace shiftmap::testing
