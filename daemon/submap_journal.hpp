// Which sub-maps of this run the archive holds, and the SHA-256 of each: what decides whether a message is believed.
//
// Written when SubmapArchive::save() has returned and before the sub-map is published. Any thread.
#pragma once

#include <cstdint>
#include <optional>
#include <unordered_map>

#include "daemon/mutex.hpp"
#include "slam/base/sha256.hpp"

namespace submapd {

class SubmapJournal {
 public:
  void add(std::uint32_t index, const Sha256& hash) {
    const MutexLock lock(mutex_);
    hashes_[index] = hash;
  }
  [[nodiscard]] std::optional<Sha256> find(std::uint32_t index) const {
    const MutexLock lock(mutex_);
    const auto found = hashes_.find(index);
    return found == hashes_.end() ? std::nullopt : std::optional(found->second);
  }

 private:
  mutable Mutex mutex_;
  std::unordered_map<std::uint32_t, Sha256> hashes_ GUARDED_BY(mutex_);
};

}  // namespace submapd
