// The time in which scans are neither mapped nor recorded, because the operator paused the run.
//
// Begins and ends a little in the future, so that mapper and recorder, which look at each scan's own time, leave out
// the same scans. pause() and resume() by the control thread, the rest by any; nothing blocks.
#pragma once

#include <atomic>
#include <cstdint>
#include <limits>

namespace submapd {

class PauseWindow {
 public:
  // Scans take some 50 ms from their first beam to their readers.
  static constexpr std::int64_t kLead_ns = 250'000'000;

  void pause(std::int64_t now_ns) {
    // In this order: a reader between the two sees a window that has not begun.
    from_ns_.store(now_ns + kLead_ns);
    until_ns_.store(kNever);
  }
  void resume(std::int64_t now_ns) { until_ns_.store(now_ns + kLead_ns); }

  [[nodiscard]] bool contains(std::int64_t first_beam_mono_ns) const noexcept {
    return first_beam_mono_ns >= from_ns_.load() && first_beam_mono_ns < until_ns_.load();
  }
  // From pause() to resume().
  [[nodiscard]] bool paused() const noexcept { return from_ns_.load() != kNever && until_ns_.load() == kNever; }

 private:
  static constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();
  std::atomic<std::int64_t> from_ns_{kNever};
  std::atomic<std::int64_t> until_ns_{kNever};
};

}  // namespace submapd
