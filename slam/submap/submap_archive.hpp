// The finished sub-maps of one run on disk: files NNNNNN.submap in one folder (submap-format.md), read through a cache.
//
// Two roles may work at the same time: one thread save()s, another load()s. A sub-map is on the disk, whole and synced,
// when save() returns, and never changes after that.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <list>
#include <memory>
#include <unordered_map>

#include "slam/base/sha256.hpp"
#include "slam/base/status.hpp"
#include "slam/submap/finished_submap.hpp"
#include "slam/submap/submap_source.hpp"

namespace submapd {

// A budget class as health and metrics report it.
struct BytesUse {
  std::size_t used = 0;
  std::size_t peak = 0;
  std::size_t limit = 0;
};

class SubmapArchive : public SubmapSource {
 public:
  // The archive in `folder`, which is made if it is missing. The cache keeps at most `cache_bytes_limit` by
  // memory_bytes(); a sub-map above the limit is loaded each time.
  [[nodiscard]] static Expected<std::unique_ptr<SubmapArchive>> open(const std::filesystem::path& folder,
                                                                     std::size_t cache_bytes_limit);

  // Writes the sub-map under its id.index; returns the SHA-256 of the file. Errors: kInvalidArgument (values that could
  // not be loaded again, or an index that is there with other values), kExhausted (too large for the format), kIo.
  Expected<Sha256> save(const FinishedSubmap& submap);

  // Errors: kNotFound, kIo, kCorrupt (with the file's name).
  Expected<std::shared_ptr<const FinishedSubmap>> load(std::uint32_t index) override;
  void release() override;

  [[nodiscard]] std::filesystem::path path_of(std::uint32_t index) const;

  // Of the cache; call from the loading thread.
  [[nodiscard]] BytesUse cache_bytes() const { return bytes_; }
  [[nodiscard]] std::uint64_t files_read() const { return files_read_; }

 private:
  struct Cached {
    std::uint32_t index = 0;
    std::size_t bytes = 0;
    std::shared_ptr<const FinishedSubmap> submap;
  };

  SubmapArchive(std::filesystem::path folder, std::size_t cache_bytes_limit);
  void keep(std::uint32_t index, std::shared_ptr<const FinishedSubmap> submap);

  const std::filesystem::path folder_;
  // The cache belongs to the loading thread; save() does not touch it.
  BytesUse bytes_;
  std::uint64_t files_read_ = 0;
  std::list<Cached> recent_;  // latest use first
  std::unordered_map<std::uint32_t, std::list<Cached>::iterator> by_index_;
};

}  // namespace submapd
