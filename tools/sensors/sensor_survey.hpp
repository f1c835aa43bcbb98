// Looks at all scanners that are plugged in: asks each who it is, and lets it measure for a moment to see its rate.
//
// Blocking; needs the devices for itself, so not while the daemon runs. Any thread.
#pragma once

#include <string>
#include <vector>

#include "driver/scanners.hpp"
#include "slam/base/status.hpp"

namespace submapd::tools {

struct SurveyOptions {
  driver::RoleRules roles;  // to show who has which role already
  double longest_s = 8.0;   // a scanner that was just powered needs some seconds
  double measure_s = 1.0;   // for the rate
  std::string self_test;    // serial number of the scanner that tries scans with intensities; empty: none
};

struct SurveyedSensor {
  driver::ScannerInfo info;
  std::string role;      // "H", "V" or "-"
  double rate_hz = 0.0;  // scans that arrived; 0 if it does not measure
};

[[nodiscard]] Expected<std::vector<SurveyedSensor>> survey_sensors(const SurveyOptions& options);

// For people, and one JSON array for programs.
[[nodiscard]] std::string table_of(const std::vector<SurveyedSensor>& sensors);
[[nodiscard]] std::string json_of(const std::vector<SurveyedSensor>& sensors);

}  // namespace submapd::tools
