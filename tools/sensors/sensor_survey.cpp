#include "tools/sensors/sensor_survey.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>
#include <utility>

#include "driver/usb/usb_host.hpp"

namespace submapd::tools {
namespace {

using Clock = std::chrono::steady_clock;

// Gives every scanner a sink that only counts, whatever its role.
class Survey final : public driver::UsbClients {
 public:
  explicit Survey(const SurveyOptions& options) : options_(options) {}
  Survey(const Survey&) = delete;
  Survey& operator=(const Survey&) = delete;
  ~Survey() = default;

  // Waits until every scanner has shown what it can, or until the time is over.
  void wait() {
    std::unique_lock lock(mutex_);
    const auto end = Clock::now() + std::chrono::duration<double>(options_.longest_s);
    while (!settled() && Clock::now() < end) {
      constexpr auto kLook = std::chrono::milliseconds(50);  // a stream settles by time alone
      changed_.wait_for(lock, kLook);
    }
    for (const auto& scanner : scanners_) {
      result_.push_back(scanner->result(options_.roles));
    }
    std::sort(result_.begin(), result_.end(),
              [](const SurveyedSensor& a, const SurveyedSensor& b) { return a.info.port.path < b.info.port.path; });
  }
  [[nodiscard]] std::vector<SurveyedSensor> result() { return std::move(result_); }

  driver::LinkClient* arrived(const driver::UsbPort& port) override {
    const std::lock_guard lock(mutex_);
    scanners_.push_back(std::make_unique<Scanner>(*this, port));
    return &scanners_.back()->sensor;
  }
  void cannot_open(const driver::UsbPort& port, const driver::Error& error) override {
    const std::lock_guard lock(mutex_);
    auto found = std::find_if(scanners_.begin(), scanners_.end(),
                              [&port](const auto& scanner) { return scanner->port.path == port.path; });
    if (found == scanners_.end()) {
      found = scanners_.insert(scanners_.end(), std::make_unique<Scanner>(*this, port));
    }
    (*found)->status.words = error.message;
    (*found)->refused = true;
  }
  void gone(const driver::UsbPort& /*port*/, driver::LinkClient* client, const driver::UsbCounters&) override {
    const std::lock_guard lock(mutex_);
    std::erase_if(scanners_, [client](const auto& scanner) { return &scanner->sensor == client; });
  }
  void served() noexcept override {
    const std::lock_guard lock(mutex_);
    looked_ = true;
    changed_.notify_all();
  }

 private:
  struct Scanner final : driver::SensorOwner, driver::SensorSink {
    Scanner(Survey& survey, const driver::UsbPort& where)
        : all(survey), port(where), sensor(no_clock(), where.path, *this) {}

    static driver::SensorOptions no_clock() {
      driver::SensorOptions options;
      options.first_samples = 0;
      return options;
    }
    driver::Expected<driver::SensorAssignment> assign(const driver::SensorIdentity& identity) override {
      const std::string& wanted = all.options_.self_test;
      return driver::SensorAssignment{this, false, !wanted.empty() && driver::same_serial(identity.serial, wanted)};
    }
    void on_status(const driver::SensorStatus& changed) noexcept override {
      const std::lock_guard lock(all.mutex_);
      status = changed;
    }
    void on_scan(const driver::scip::ScanData&) noexcept override {
      const std::lock_guard lock(all.mutex_);
      last = Clock::now();
      first = scans++ == 0 ? last : first;
    }
    void on_damaged_scan() noexcept override {}
    void on_time(const driver::TimeSample&) noexcept override {}
    void on_new_clock() noexcept override {}
    bool knows_clock() const noexcept override { return true; }

    [[nodiscard]] bool settled(double measure_s) const {
      const bool measured = scans > 1 && std::chrono::duration<double>(last - first).count() >= measure_s;
      return refused || measured || status.state == driver::SensorState::kTrouble;
    }
    [[nodiscard]] SurveyedSensor result(const driver::RoleRules& roles) const {
      SurveyedSensor out;
      out.info = {port, status, std::nullopt, sensor.counters()};
      const auto role = driver::find_role(roles, status.identity, {});
      out.role = role && !status.identity.serial.empty() ? std::string(1, driver::letter_of(*role)) : "-";
      if (scans > 1) {
        out.rate_hz = static_cast<double>(scans - 1) / std::chrono::duration<double>(last - first).count();
      }
      return out;
    }

    Survey& all;
    const driver::UsbPort port;
    driver::SensorStatus status;
    bool refused = false;
    std::uint64_t scans = 0;
    Clock::time_point first;
    Clock::time_point last;
    driver::Sensor sensor;
  };

  [[nodiscard]] bool settled() const {
    return looked_ && std::all_of(scanners_.begin(), scanners_.end(),
                                  [this](const auto& scanner) { return scanner->settled(options_.measure_s); });
  }

  SurveyOptions options_;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool looked_ = false;
  std::vector<std::unique_ptr<Scanner>> scanners_;
  std::vector<SurveyedSensor> result_;
};

std::string state_of(const driver::SensorStatus& status) {
  std::string text(name(status.state));
  if (!status.words.empty()) {
    text += ": " + status.words;
  }
  if (status.self_test) {
    const driver::SelfTest& test = *status.self_test;
    text +=
        fmt::format("; self-test {}: {} scans with intensities, {} damaged, {} lost",
                    test.passed() ? "passed" : "FAILED, leave intensity = false", test.scans, test.damaged, test.lost);
  }
  return text;
}

nlohmann::ordered_json json_of(const std::optional<driver::SelfTest>& test) {
  if (!test) {
    return nullptr;
  }
  return {{"passed", test->passed()}, {"scans", test->scans}, {"damaged", test->damaged}, {"lost", test->lost}};
}

}  // namespace

Expected<std::vector<SurveyedSensor>> survey_sensors(const SurveyOptions& options) {
  Survey survey(options);
  auto host = driver::UsbHost::create({}, survey);
  if (!host) {
    return failure(StatusCode::kIo, host.error().message);
  }
  std::thread events([&host] { (*host)->run(); });
  survey.wait();
  (*host)->stop();
  events.join();
  return survey.result();
}

std::string table_of(const std::vector<SurveyedSensor>& sensors) {
  std::string text = fmt::format("{:<5}{:<9}{:<10}{:<34}{:<22}{:>8}  {}\n", "role", "port", "serial", "product",
                                 "firmware", "scans/s", "state");
  for (const SurveyedSensor& sensor : sensors) {
    const driver::SensorIdentity& identity = sensor.info.status.identity;
    text +=
        fmt::format("{:<5}{:<9}{:<10}{:<34}{:<22}{:>8.1f}  {}\n", sensor.role, sensor.info.port.path,
                    identity.serial.empty() ? "?" : identity.serial, identity.product.empty() ? "?" : identity.product,
                    identity.firmware.empty() ? "?" : identity.firmware, sensor.rate_hz, state_of(sensor.info.status));
  }
  return text;
}

std::string json_of(const std::vector<SurveyedSensor>& sensors) {
  nlohmann::ordered_json all = nlohmann::ordered_json::array();
  for (const SurveyedSensor& sensor : sensors) {
    const driver::SensorStatus& status = sensor.info.status;
    all.push_back({{"role", sensor.role == "-" ? nlohmann::ordered_json() : nlohmann::ordered_json(sensor.role)},
                   {"port", sensor.info.port.path},
                   {"serial", status.identity.serial},
                   {"product", status.identity.product},
                   {"firmware", status.identity.firmware},
                   {"state", std::string(name(status.state))},
                   {"words", status.words},
                   {"rate_hz", sensor.rate_hz},
                   {"self_test", json_of(status.self_test)}});
  }
  // Strings come from devices: bytes that are no UTF-8 must not stop the rest.
  return all.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + '\n';
}

}  // namespace submapd::tools
