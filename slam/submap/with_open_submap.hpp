// An archive and, on top of it, the sub-map that is still open: what a saved map is made of.
#pragma once

#include <memory>
#include <utility>

#include "slam/submap/submap_source.hpp"

namespace submapd {

// The archive must outlive it.
class WithOpenSubmap final : public SubmapSource {
 public:
  WithOpenSubmap(SubmapSource& archive, std::shared_ptr<const FinishedSubmap> open)
      : archive_(archive), open_(std::move(open)) {}
  Expected<std::shared_ptr<const FinishedSubmap>> load(std::uint32_t index) override {
    if (index == open_->id.index) return open_;
    return archive_.load(index);
  }
  void release() override { archive_.release(); }

 private:
  SubmapSource& archive_;
  const std::shared_ptr<const FinishedSubmap> open_;
};

}  // namespace submapd
