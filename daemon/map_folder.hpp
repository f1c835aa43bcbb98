// A saved map's folder, maps/NAME: it appears whole and on the disk, or not at all (saved-map.md).
//
// Written aside under a name that no map can have; commit() writes MANIFEST, syncs every file and renames the folder.
// Without commit() the destructor removes what was written. One thread; blocks on the disk.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

#include "slam/base/status.hpp"

namespace submapd {

// What maps, runs and marks may be called: [A-Za-z0-9_][A-Za-z0-9._-]{0,63}.
[[nodiscard]] bool is_name(std::string_view name);
// The same in words.
inline constexpr const char* kNameRule =
    "a name has 1 to 64 letters, digits, points, dashes and underscores and begins with a letter, a digit or an "
    "underscore";

class MapFolder {
 public:
  // `maps` must exist. Errors: kInvalidArgument (no name for a map, or a map of that name is there and `replace` is
  // false), kIo.
  [[nodiscard]] static Expected<MapFolder> begin(const std::filesystem::path& maps, const std::string& name,
                                                 bool replace);
  MapFolder(MapFolder&& other) noexcept;
  MapFolder& operator=(MapFolder&&) = delete;
  ~MapFolder();

  // Where the files go meanwhile.
  [[nodiscard]] const std::filesystem::path& aside() const { return aside_; }

  // `manifest` is what MANIFEST says besides its files. Errors: kIo, kInternal.
  Status commit(nlohmann::json manifest);

 private:
  MapFolder(std::filesystem::path path, std::filesystem::path aside, bool replace)
      : path_(std::move(path)), aside_(std::move(aside)), replace_(replace) {}

  std::filesystem::path path_;
  std::filesystem::path aside_;  // empty: nothing to remove
  bool replace_;
};

}  // namespace submapd
