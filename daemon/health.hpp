// The daemon's state in one value, and how it is told: CART_HEALTH, a JSON object, one line for people.
//
// Values and pure functions; any thread.
#pragma once

#include <array>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>

#include "daemon/control_server.hpp"
#include "daemon/lcm_requests.hpp"
#include "daemon/map_saver.hpp"
#include "daemon/mapper_thread.hpp"
#include "daemon/odometry_input.hpp"
#include "daemon/optimizer_thread.hpp"
#include "daemon/publisher_thread.hpp"
#include "daemon/recorder_thread.hpp"
#include "driver/scanners.hpp"
#include "submapd/health_t.hpp"

namespace submapd {

struct ScannerHealth {
  bool configured = false;
  std::string serial;  // as configured, or as it answered
  std::string words;   // what is the matter; empty if all is well
  driver::SensorState state = driver::SensorState::kClosed;
  bool present = false;
  std::uint64_t scans = 0;    // received since the run started
  std::uint64_t dropped = 0;  // received, but lost between USB and its reader
  std::uint64_t bad_frames = 0;
  std::uint64_t reconnects = 0;
  double rate_hz = 0.0;         // over the last second
  double clock_error_ms = 0.0;  // bound of the newest scan's stamp
};

struct Health {
  std::int64_t utime_us = 0;
  std::string run;  // the folder's name
  Uuid cart_id;
  Uuid run_id;
  std::array<ScannerHealth, driver::kSensorRoles> scanners;  // by SensorRole
  std::string input;                                         // usb, lcm or file
  bool input_ended = false;
  std::string input_trouble;
  MapperState mapper;
  RecorderState recorder;
  PublisherState publisher;
  std::uint32_t graph_version = 0;
  OptimizerCounters optimizer;
  OptimizerThreadCounters optimizer_thread;
  std::string optimizer_trouble;  // why it has ended; empty while it runs
  SaveProgress save;              // of the newest map asked for
  double pose_hz = 0.0;           // sent over the last second
  double disk_minutes = -1.0;     // until raw recording stops, at the rate of the last ten seconds; -1: not known
  LcmInputCounters inputs;
  std::optional<OdometryCounters> odometry;  // if it is configured
  ControlServerCounters clients;             // of the control socket
  std::uint64_t hook_failed = 0;
  std::string button_trouble;
  double longest_turn_ms = 0.0;  // of the control thread since the run began
  bool paused = false;
  std::size_t rss_bytes = 0;
  std::size_t budget_bytes = 0;  // the sum of all limits
};

// health_t's.
[[nodiscard]] std::int8_t state_of(const Health& health);
[[nodiscard]] const char* state_name(std::int8_t state);
// The worst that is wrong and what to do; empty if nothing is.
[[nodiscard]] std::string trouble_of(const Health& health);
// For systemctl status and submapctl status.
[[nodiscard]] std::string words_of(const Health& health);
[[nodiscard]] health_t message_of(const Health& health);
[[nodiscard]] nlohmann::json json_of(const Health& health);

// True if something changed that is worth a message at once.
[[nodiscard]] bool differs(const Health& before, const Health& now);

}  // namespace submapd
