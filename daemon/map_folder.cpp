#include "daemon/map_folder.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>
#include <span>
#include <system_error>
#include <utility>
#include <vector>

#include "slam/base/atomic_file.hpp"
#include "slam/base/sha256.hpp"

namespace submapd {
namespace {

constexpr std::size_t kLongestName = 64;
constexpr const char* kManifest = "MANIFEST";

Status io_error(const std::filesystem::path& path, const char* step) {
  return {StatusCode::kIo, fmt::format("{}: cannot {}: {}", path.string(), step, std::strerror(errno))};
}

// Name, size and hash of every file, in order of name.
Expected<nlohmann::json> list_files(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> paths;
  std::error_code error;
  for (auto entry = std::filesystem::directory_iterator(folder, error); !error && entry != end(entry);
       entry.increment(error)) {
    paths.push_back(entry->path());
  }
  if (error) return failure(StatusCode::kIo, fmt::format("{}: {}", folder.string(), error.message()));
  std::sort(paths.begin(), paths.end());
  nlohmann::json files = nlohmann::json::array();
  for (const std::filesystem::path& path : paths) {
    const Expected<Sha256> hash = sha256_of_file(path);
    if (!hash) return failure(hash.error());
    const std::uintmax_t bytes = std::filesystem::file_size(path, error);
    if (error) return failure(StatusCode::kIo, fmt::format("{}: {}", path.string(), error.message()));
    files.push_back({{"name", path.filename().string()}, {"bytes", bytes}, {"sha256", hex_of(*hash)}});
  }
  return files;
}

}  // namespace

bool is_name(std::string_view name) {
  const auto plain = [](char c) {
    return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || c == '_';
  };
  return !name.empty() && name.size() <= kLongestName && plain(name.front()) &&
         std::all_of(name.begin(), name.end(), [&](char c) { return plain(c) || c == '.' || c == '-'; });
}

Expected<MapFolder> MapFolder::begin(const std::filesystem::path& maps, const std::string& name, bool replace) {
  if (!is_name(name)) {
    return failure(StatusCode::kInvalidArgument,
                   fmt::format("\"{}\" is no name for a map: up to {} letters, digits, points, dashes and underscores, "
                               "beginning with none of .-",
                               name, kLongestName));
  }
  const std::filesystem::path path = maps / name;
  std::error_code error;
  if (!replace && std::filesystem::exists(path, error)) {
    return failure(StatusCode::kInvalidArgument,
                   fmt::format("{} exists; take another name, or --force to replace it", path.string()));
  }
  std::string aside = (maps / fmt::format(".{}.XXXXXX", name)).string();
  if (::mkdtemp(aside.data()) == nullptr) return failure(io_error(aside, "make the folder"));
  if (::chmod(aside.c_str(), 0750) != 0) return failure(io_error(aside, "set the mode"));
  return MapFolder(path, aside, replace);
}

MapFolder::MapFolder(MapFolder&& other) noexcept
    : path_(std::move(other.path_)), aside_(std::exchange(other.aside_, {})), replace_(other.replace_) {}

MapFolder::~MapFolder() {
  std::error_code ignored;
  if (!aside_.empty()) std::filesystem::remove_all(aside_, ignored);
}

// Every file in it was synced when it was written, by AtomicFile.
Status MapFolder::commit(nlohmann::json manifest) {
  Expected<nlohmann::json> files = list_files(aside_);
  if (!files) return files.error();
  manifest["files"] = std::move(*files);
  const std::string text = manifest.dump(2) + "\n";
  if (Status status = atomic_write_file(aside_ / kManifest, std::as_bytes(std::span(text))); !status.ok())
    return status;

  unsigned how = RENAME_NOREPLACE;
  if (::renameat2(AT_FDCWD, aside_.c_str(), AT_FDCWD, path_.c_str(), how) != 0) {
    if (errno != EEXIST || !replace_) return io_error(path_, "put the map in its place");
    how = RENAME_EXCHANGE;
    if (::renameat2(AT_FDCWD, aside_.c_str(), AT_FDCWD, path_.c_str(), how) != 0) {
      return io_error(path_, "replace the map");
    }
  }  // aside_ is free now, or the old map, which the destructor removes
  Status synced = sync_folder(path_.parent_path());
  if (!synced.ok())
    (void)::renameat2(AT_FDCWD, path_.c_str(), AT_FDCWD, aside_.c_str(), how);  // the name is for the next try
  return synced;
}

}  // namespace submapd
