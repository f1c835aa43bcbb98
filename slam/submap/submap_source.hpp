// Where the optimizer gets finished sub-maps from when it needs their cells again.
#pragma once

#include <cstdint>
#include <memory>

#include "slam/base/status.hpp"
#include "slam/submap/finished_submap.hpp"

namespace submapd {

// Implemented by the archive (disk) with a bounded cache, and by tests. Called from one thread at a time.
class SubmapSource {
 public:
  SubmapSource() = default;
  SubmapSource(const SubmapSource&) = delete;
  SubmapSource& operator=(const SubmapSource&) = delete;
  virtual ~SubmapSource() = default;

  // The sub-map with that index of this run. The pointer keeps it alive; callers drop it soon, so that memory stays
  // bounded.
  virtual Expected<std::shared_ptr<const FinishedSubmap>> load(std::uint32_t index) = 0;

  // Nothing will be loaded for a while: what is kept only to save a reading may go.
  virtual void release() {}
};

}  // namespace submapd
