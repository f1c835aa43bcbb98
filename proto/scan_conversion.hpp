// A Scan as a scan_t message and back: CART_SCAN_H, CART_SCAN_V and the raw log; its echo strengths likewise.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "slam/base/ids.hpp"
#include "slam/base/status.hpp"
#include "slam/scan/scan.hpp"

namespace submapd {

// What travels beside the scan: who measured it, and its raw stamps.
struct ScanOrigin {
  Uuid cart;
  Uuid run;
  std::int64_t device_ms = -1;  // the sensor's own stamp; -1: none
  std::int64_t mono_ns = -1;    // host's monotonic clock; -1: none
  friend bool operator==(const ScanOrigin&, const ScanOrigin&) = default;
};

struct ScanMessage {
  ScanOrigin origin;
  Scan scan;
};

// REQUIRES: at most kMaxBeams ranges, scan.index below 2^63. Lossless.
[[nodiscard]] std::vector<std::byte> encode_scan(const Scan& scan, const ScanOrigin& origin);

// Errors: kCorrupt (not a scan_t, or values no scan has).
[[nodiscard]] Expected<ScanMessage> decode_scan(std::span<const std::byte> bytes);

// Echo strengths of the scan with this number and stamp: CART_INTENSITY_H, CART_INTENSITY_V.
struct ScanIntensities {
  std::int64_t stamp_us = 0;
  std::uint64_t index = 0;
  std::vector<std::uint16_t> values;  // one a beam
};

// REQUIRES: as for encode_scan().
[[nodiscard]] std::vector<std::byte> encode_intensities(const ScanIntensities& intensities, const ScanOrigin& origin);

// Errors: kCorrupt.
[[nodiscard]] Expected<ScanIntensities> decode_intensities(std::span<const std::byte> bytes);

}  // namespace submapd
