// Does a scan show the place that the scan before it showed?
//
// Forty times a second two scans in a row see nearly the same. If most of a scan is elsewhere, and much of it behind
// what was seen before, the cart did not drive there: it was lifted, or time is missing that no stamp tells of. People
// who step in front of the scanner hide what was there, they open no view behind it.
#pragma once

#include <array>

#include "slam/matching/scan_points.hpp"

namespace submapd {

class ScanContinuity {
 public:
  // Shares of the points that fall into directions in which the scan before saw something.
  struct Change {
    double same = 1.0;
    double farther = 0.0;  // behind what was seen
    int compared = 0;
  };

  // `before_from_now`: base frame of the kept scan from the new one's.
  [[nodiscard]] Change compare(const ScanPoints& now, const Pose2& before_from_now) const;
  void keep(const ScanPoints& scan);

 private:
  static constexpr int kBins = 960;
  struct Reach {
    float nearest_m = 1e9F;
    float farthest_m = 0.0F;
  };
  [[nodiscard]] static int bin_of(float x, float y);

  Eigen::Vector2f origin_ = Eigen::Vector2f::Zero();
  std::array<Reach, kBins> reach_;
};

}  // namespace submapd
