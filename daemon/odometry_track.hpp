// The newest odometry, and where it has the cart at the first beam of a scan: read by the usb thread between a scan and
// its rings, so that mapper and raw log get the same.
//
// A pose between two samples is interpolated along the constant twist between them; a little beyond the newest it is
// extrapolated by the twist before. Where samples are missing, or the odometry's frame has jumped, a scan has none, and
// the mapper goes on without. Neither allocates nor locks. Threads: at() by one, joined() by any.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "driver/ring/spsc_ring.hpp"
#include "driver/scan_pipeline.hpp"
#include "slam/base/pose2.hpp"

namespace submapd {

struct OdometrySample {
  std::int64_t mono_ns = 0;   // of the measurement; grows from sample to sample
  Pose2 odom_from_base;       // within kMaxCoordinate_m
  std::uint32_t stretch = 0;  // counts jumps: samples of two stretches say nothing about each other
};
// Faster than any cart: the frame was set anew between the two. REQUIRES: now is later.
[[nodiscard]] bool is_jump(const OdometrySample& before, const OdometrySample& now) noexcept;
using OdometryRing = driver::SpscRing<OdometrySample>;

class OdometryTrack final : public driver::OdometrySource {
 public:
  static constexpr std::int64_t kLongestGap_ns = 250'000'000;    // between samples of which one is before, one after
  static constexpr std::int64_t kExtrapolation_ns = 50'000'000;  // beyond the newest sample

  // `samples` must outlive the object, which is its consumer.
  explicit OdometryTrack(OdometryRing& samples) : samples_(samples) {}

  // The pose at an instant. REQUIRES: not much earlier than the one before.
  [[nodiscard]] std::optional<Pose2> pose_at(std::int64_t mono_ns) noexcept;
  [[nodiscard]] bool at(std::int64_t mono_ns, driver::Odometry& odometry) noexcept override;

  [[nodiscard]] std::uint64_t joined() const { return joined_.load(std::memory_order_relaxed); }  // scans that have one

 private:
  static constexpr std::size_t kKept = 256;

  [[nodiscard]] const OdometrySample& newest(std::size_t back) const { return kept_[(count_ - 1 - back) % kKept]; }
  [[nodiscard]] std::optional<OdometrySample> find(std::int64_t mono_ns) const noexcept;

  OdometryRing& samples_;
  std::array<OdometrySample, kKept> kept_{};
  std::size_t count_ = 0;  // samples ever kept
  OdometrySample last_;    // of the last scan that a pose was found for
  std::atomic<std::uint64_t> joined_{0};
};

}  // namespace submapd
