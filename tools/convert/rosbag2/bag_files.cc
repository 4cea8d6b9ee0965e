// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/rosbag2/bag_files.h"

#include <yaml-cpp/yaml.h>
#include <zstd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>

#include "mapstore/core/input_file.h"
#include "proto/mcap/compression.h"
#include "proto/mcap/format.h"

namespace shiftmap::rosbag2 {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxMetadataBytes = std::size_t{4} << 20;
constexpr std::size_t kMaxFiles = 100'000;
constexpr std::string_view kZstdMagic("\x28\xb5\x2f\xfd", 4);
constexpr const char* kWalSuffix = "-wal";

Status OfBag(const std::string& path, const Status& status) {
  return Annotate(status, "bag '{}'", path);
}

// What a file is by its name; nothing for a file that is not of a bag.
std::optional<BagFile> Classify(const fs::path& path) {
  BagFile file;
  file.path = path.string();
  fs::path name = path.filename();
  if (name.extension() == ".zstd") {
    file.zstd = true;
    name = name.stem();
  }
  if (name.extension() == ".mcap") {
    file.storage = BagFile::Storage::kMcap;
  } else if (name.extension() == ".db3") {
    file.storage = BagFile::Storage::kSqlite;
  } else {
    return std::nullopt;
  }
  return file;
}

StatusOr<std::vector<std::string>> ListedFiles(const std::string& text) {
  try {
    const YAML::Node list = YAML::Load(text)["rosbag2_bagfile_information"]["relative_file_paths"];
    if (!list.IsSequence()) {
      return InvalidArgument("no list rosbag2_bagfile_information: relative_file_paths");
    }
    if (list.size() > kMaxFiles) return InvalidArgument("more than {} files", kMaxFiles);
    std::vector<std::string> names;
    for (const YAML::Node& name : list) names.push_back(name.as<std::string>());
    return names;
  } catch (const YAML::Exception& error) {
    return InvalidArgument("{}", error.what());
  }
}

// Some recorders listed names with the folder's before them; a bag's files are all in it.
StatusOr<std::vector<BagFile>> FromMetadata(const fs::path& folder) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      const std::string text,
      ReadInputFile("file", (folder / "metadata.yaml").string(), kMaxMetadataBytes));
  const auto names = ListedFiles(text);
  if (!names.ok()) return InvalidArgument("metadata.yaml: {}", Message(names.status()));
  std::vector<BagFile> files;
  for (const std::string& name : *names) {
    const std::optional<BagFile> file = Classify(folder / fs::path(name).filename());
    if (!file) {
      return InvalidArgument("metadata.yaml: file '{}', expected .mcap or .db3, or .zstd of them",
                             name);
    }
    files.push_back(*file);
  }
  if (files.empty()) return InvalidArgument("metadata.yaml lists no files");
  return files;
}

// The last number in a name: recorders count the files of a bag.
long long NumberOf(const BagFile& file) {
  const std::string stem = fs::path(file.path).stem().stem().string();
  const std::size_t begin = stem.find_last_not_of("0123456789");
  return std::strtoll(stem.c_str() + (begin == std::string::npos ? 0 : begin + 1), nullptr, 10);
}

StatusOr<std::vector<BagFile>> FromFolder(const fs::path& folder) {
  std::vector<BagFile> files;
  std::error_code error;
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    const std::optional<BagFile> file = Classify(at->path());
    // A player leaves what it decompressed beside the compressed file.
    std::error_code ignored;
    if (!file || (file->zstd && fs::exists(fs::path(file->path).replace_extension(), ignored))) {
      continue;
    }
    files.push_back(*file);
    if (files.size() > kMaxFiles) return InvalidArgument("more than {} files", kMaxFiles);
  }
  if (error) return Unavailable("{}", error.message());
  if (files.empty()) return NotFound("no .mcap or .db3 file in the folder");
  std::sort(files.begin(), files.end(), [](const BagFile& a, const BagFile& b) {
    return std::pair(NumberOf(a), a.path) < std::pair(NumberOf(b), b.path);
  });
  return files;
}

StatusOr<std::vector<BagFile>> FindFiles(const std::string& path) {
  std::error_code error;
  if (!fs::exists(path, error)) return NotFound("does not exist");
  if (fs::is_directory(path, error)) {
    const bool listed = fs::exists(fs::path(path) / "metadata.yaml", error);
    return listed ? FromMetadata(path) : FromFolder(path);
  }
  const std::optional<BagFile> file = Classify(path);
  if (!file) {
    return InvalidArgument("expected a folder, a .mcap or .db3 file, or .zstd of one");
  }
  return std::vector<BagFile>{*file};
}

struct FreeStream {
  void operator()(ZSTD_DStream* stream) const { ZSTD_freeDStream(stream); }
};

// Decompresses a stream of frames within the limits of all chunks of an MCAP file.
Status DecompressStream(std::istream& in, std::ostream& out) {
  const std::unique_ptr<ZSTD_DStream, FreeStream> stream(ZSTD_createDStream());
  if (stream == nullptr) return MakeStatus(StatusCode::kResourceExhausted, "zstd: out of memory");
  std::vector<char> from(ZSTD_DStreamInSize());
  std::vector<char> to(ZSTD_DStreamOutSize());
  std::uint64_t read = 0;
  std::uint64_t written = 0;
  std::size_t hint = 0;
  while (in.read(from.data(), static_cast<std::streamsize>(from.size())), in.gcount() > 0) {
    ZSTD_inBuffer input{from.data(), static_cast<std::size_t>(in.gcount()), 0};
    read += input.size;
    for (bool more = true; more;) {
      ZSTD_outBuffer output{to.data(), to.size(), 0};
      hint = ZSTD_decompressStream(stream.get(), &output, &input);
      if (ZSTD_isError(hint) != 0U) return DataLoss("zstd: {}", ZSTD_getErrorName(hint));
      written += output.pos;
      if (written > mcap::kFreeExpansionBytes + mcap::kMaxExpansion * read) {
        return DataLoss("zstd: {} bytes expand to more than {}", read, written - output.pos);
      }
      out.write(to.data(), static_cast<std::streamsize>(output.pos));
      if (!out) return Unavailable("the folder for temporary files does not take it");
      more = input.pos < input.size || output.pos == output.size;
    }
  }
  if (hint != 0) return DataLoss("zstd: the file ends early");
  return OkStatus();
}

}  // namespace

StatusOr<std::vector<BagFile>> FindBagFiles(const std::string& path) {
  auto files = FindFiles(path);
  if (!files.ok()) return OfBag(path, files.status());
  return files;
}

StatusOr<ScratchCopy> ScratchCopy::Create(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(ScratchFolder folder, ScratchFolder::Make());
  std::string copy = (fs::path(folder.path()) / fs::path(path).filename()).string();
  return ScratchCopy(std::move(folder), std::move(copy));
}

StatusOr<ScratchCopy> ScratchCopy::Decompress(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(std::ifstream in, OpenInputFile(path));
  SHIFTMAP_ASSIGN_OR_RETURN(ScratchCopy copy, Create(path));
  std::ofstream out(copy.path_, std::ios::binary);
  SHIFTMAP_RETURN_IF_ERROR(DecompressStream(in, out));
  out.close();
  if (!out) return Unavailable("the folder for temporary files does not take it");
  return copy;
}

StatusOr<ScratchCopy> ScratchCopy::WithWriteAheadLog(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(ScratchCopy copy, Create(path));
  std::error_code error;
  fs::copy_file(path, copy.path_, error);
  if (!error) fs::copy_file(path + kWalSuffix, copy.path_ + kWalSuffix, error);
  if (error) return Unavailable("copy to the folder for temporary files: {}", error.message());
  return copy;
}

bool HasWriteAheadLog(const std::string& path) {
  std::error_code error;
  const auto size = fs::file_size(path + kWalSuffix, error);
  return !error && size > 0;
}

StatusOr<std::string_view> PlainMessage(std::string_view data, std::string* buffer) {
  if (!data.starts_with(kZstdMagic)) return data;
  const unsigned long long size = ZSTD_getFrameContentSize(data.data(), data.size());
  if (size == ZSTD_CONTENTSIZE_UNKNOWN || size == ZSTD_CONTENTSIZE_ERROR ||
      size > mcap::kMaxChunkBytes) {
    return DataLoss("a compressed message states no size, or one above {}", mcap::kMaxChunkBytes);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(*buffer, mcap::Decompress("zstd", data, size));
  return std::string_view(*buffer);
}

}  // namespace shiftmap::rosbag2
