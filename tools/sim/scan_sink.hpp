// Where simulated scans go: files of one format each behind one interface.
//
// A sink writes to FILE.part and gives the file its name in finish(), so a file with its name is whole. One thread.
#pragma once

#include <memory>
#include <string>

#include "slam/base/pose2.hpp"
#include "slam/base/status.hpp"
#include "slam/scan/scan.hpp"

namespace submapd::tools {

class ScanSink {
 public:
  ScanSink() = default;
  ScanSink(const ScanSink&) = delete;
  ScanSink& operator=(const ScanSink&) = delete;
  virtual ~ScanSink() = default;

  // truth: exact pose of the base at the scan's stamp.
  [[nodiscard]] virtual Status write(const Scan& scan, const Pose2& truth) = 0;
  // REQUIRES: called once, after the last scan; without it no file of that name appears.
  [[nodiscard]] virtual Status finish() = 0;
};

// CARMEN text log, one ROBOTLASER1 line a scan: ranges in metres with three decimals, stamps in seconds with six,
// angles with fifteen. Both pose fields hold the odometry, 0 0 0 without any; the header line "# sweep_s S" has the
// time from the first beam to the last. A path that ends in .gz is compressed.
[[nodiscard]] Expected<std::unique_ptr<ScanSink>> open_clf_sink(const std::string& path);

// LCM log: one scan_t event a scan on CART_SCAN_H, as the daemon records it. The odometry travels in the scan.
[[nodiscard]] Expected<std::unique_ptr<ScanSink>> open_lcm_sink(const std::string& path);

// TUM trajectory of the truth: "stamp x y z qx qy qz qw", stamps with six decimals, the rest with nine.
[[nodiscard]] Expected<std::unique_ptr<ScanSink>> open_truth_sink(const std::string& path);

}  // namespace submapd::tools
