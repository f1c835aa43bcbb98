// The driver as the daemon runs it, alone in a process, so that its processor time can be told: scanners through
// libusb, clock, rings, and a reader for each ring. Writes what it saw for scanners_soak.py to judge.
#include <fmt/format.h>
#include <sys/resource.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "driver/monotonic.hpp"
#include "driver/scan_pipeline.hpp"
#include "driver/scanners.hpp"
#include "driver/sim/sim_sensor.hpp"

namespace submapd::driver {
namespace {

// Notes when each scan was in the ring.
class TimedPipeline final : public SensorSink {
 public:
  struct Entry {
    std::uint32_t stamp_ms;
    std::int64_t in_ring_ns;
  };
  TimedPipeline(ScanRing& ring, std::size_t scans) : pipeline_({}, {&ring, nullptr}) { entries.reserve(scans); }

  void on_scan(const scip::ScanData& scan) noexcept override {
    pipeline_.on_scan(scan);
    if (entries.size() < entries.capacity()) {
      entries.push_back({static_cast<std::uint32_t>(scan.time), monotonic_now_ns()});
    }
  }
  void on_damaged_scan() noexcept override { pipeline_.on_damaged_scan(); }
  void on_time(const TimeSample& sample) noexcept override { pipeline_.on_time(sample); }
  void on_new_clock() noexcept override { pipeline_.on_new_clock(); }
  bool knows_clock() const noexcept override { return pipeline_.knows_clock(); }

  // After the event thread has ended.
  [[nodiscard]] const SensorClock& clock() const { return pipeline_.clock(); }

  std::vector<Entry> entries;

 private:
  ScanPipeline pipeline_;
};

struct Seen {
  DeviceScan last;
  std::uint64_t scans = 0;
};

std::uint64_t hash_of(const DeviceScan& scan) {
  std::array<std::uint32_t, DeviceScan::kMaxBeams> ranges_mm{};
  std::copy_n(scan.ranges_mm.begin(), scan.beams, ranges_mm.begin());
  return hash_ranges(std::span(ranges_mm).first(scan.beams));
}

class OutputFile {
 public:
  explicit OutputFile(const std::string& path) : file_(std::fopen(path.c_str(), "we")) {}
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;
  ~OutputFile() {
    if (file_ != nullptr) {
      std::fclose(file_);
    }
  }
  void print(const std::string& line) { std::fwrite(line.data(), 1, line.size(), file_); }
  [[nodiscard]] bool ok() const { return file_ != nullptr; }

 private:
  std::FILE* file_;
};

double cpu_s() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

// What libusb and the bus cost by themselves: asks for the stream and throws its bytes away.
class BareReader final : public UsbClients, private LinkClient {
 public:
  LinkClient* arrived(const UsbPort& /*port*/) override { return this; }
  void cannot_open(const UsbPort& /*port*/, const Error& /*error*/) override {}
  void gone(const UsbPort& /*port*/, LinkClient* /*client*/, const UsbCounters& seen) override {
    transfers += seen.transfers_in;
  }
  void served() noexcept override {}

  std::uint64_t transfers = 0;  // of lines that are gone

 private:
  void on_open(ByteLink& link, std::int64_t /*now_ns*/) noexcept override {
    constexpr std::string_view kStream = "QT\nMD0000108001000\n";
    static_cast<void>(link.write({reinterpret_cast<const std::uint8_t*>(kStream.data()), kStream.size()}));
  }
  void on_close(std::int64_t /*now_ns*/) noexcept override {}
  void on_stop(std::int64_t /*now_ns*/) noexcept override {}
  void on_bytes(std::span<const std::uint8_t> /*bytes*/, std::int64_t /*stamp_ns*/,
                std::uint64_t /*offset*/) noexcept override {}
  void on_fault(LinkFault /*fault*/, std::int64_t /*now_ns*/) noexcept override {}
  void on_time(std::int64_t /*now_ns*/) noexcept override {}
  [[nodiscard]] std::int64_t next_time_ns() const noexcept override { return kNever_ns; }
};

int run_bare(double run_s, const UsbOptions& usb) {
  BareReader reader;
  auto host = UsbHost::create(usb, reader);
  if (!host) {
    fmt::print(stderr, "scanners_soak: {}\n", host.error().message);
    return 1;
  }
  std::thread events([&host] { (*host)->run(); });
  std::this_thread::sleep_for(std::chrono::seconds(1));  // until they stream
  const double cpu_before_s = cpu_s();
  std::this_thread::sleep_for(std::chrono::duration<double>(run_s));
  const double share = (cpu_s() - cpu_before_s) / run_s;
  (*host)->stop();
  events.join();
  fmt::print("bare: {} transfers, processor {:.2f} % of one core\n", reader.transfers, 100.0 * share);
  return reader.transfers > 0 ? 0 : 1;
}

int run(double run_s, const std::string& out, const std::array<std::string, 2>& serials, const UsbOptions& usb) {
  auto event = EventFd::open();
  if (!event) {
    fmt::print(stderr, "scanners_soak: {}\n", event.error().message);
    return 1;
  }
  Doorbell bell(std::move(*event));
  std::array<ScanRing, 2> rings = {ScanRing(160, &bell), ScanRing(160, &bell)};
  const auto most = static_cast<std::size_t>(41.0 * (run_s + 20.0));
  std::array<TimedPipeline, 2> sinks = {TimedPipeline(rings[0], most), TimedPipeline(rings[1], most)};
  ScannersOptions options;
  options.roles = {RoleRule{serials[0], ""}, RoleRule{serials[1], ""}};
  Scanners scanners(options, {&sinks[0], &sinks[1]});
  auto host = UsbHost::create(usb, scanners);
  if (!host) {
    fmt::print(stderr, "scanners_soak: {}\n", host.error().message);
    return 1;
  }
  OutputFile file(out);
  if (!file.ok()) {
    fmt::print(stderr, "scanners_soak: cannot write {}\n", out);
    return 1;
  }
  std::thread events([&host] { (*host)->run(); });

  std::array<Seen, 2> seen;
  const auto both = [&seen] { return seen[0].scans > 0 && seen[1].scans > 0; };
  std::int64_t end_ns = monotonic_now_ns() + 30'000'000'000;  // for the start-up
  double cpu_before_s = 0.0;
  bool measuring = false;
  while (monotonic_now_ns() < end_ns) {
    bell.wait([&rings] { return rings[0].has_data() || rings[1].has_data(); }, std::chrono::milliseconds(100));
    for (std::size_t i = 0; i < 2; ++i) {
      while (const DeviceScan* const scan = rings[i].front()) {
        seen[i].last = *scan;
        ++seen[i].scans;
        file.print(fmt::format("scan {} {} {} {} {:016x}\n", serials[i], scan->device_ms, scan->first_beam_mono_ns,
                               scan->error_bound_ns, hash_of(*scan)));
        rings[i].pop();
      }
    }
    if (!measuring && both()) {
      measuring = true;
      end_ns = monotonic_now_ns() + static_cast<std::int64_t>(1e9 * run_s);
      cpu_before_s = cpu_s();
    }
  }
  const double share = measuring ? (cpu_s() - cpu_before_s) / run_s : 0.0;
  const auto states = scanners.snapshot();
  (*host)->stop();
  events.join();
  for (std::size_t i = 0; i < 2; ++i) {
    for (const TimedPipeline::Entry& entry : sinks[i].entries) {
      file.print(fmt::format("ring {} {} {}\n", serials[i], entry.stamp_ms, entry.in_ring_ns));
    }
    file.print(fmt::format("total {} {} {} {} {}\n", serials[i], seen[i].scans, seen[i].last.lost,
                           seen[i].last.repeated, rings[i].dropped()));
    file.print(
        fmt::format("clock {} {} {}\n", serials[i], sinks[i].clock().usb_grid_us(), sinks[i].clock().contradictions()));
  }
  for (const ScannerInfo& scanner : states) {
    file.print(fmt::format("counters {} {} {} {} {}\n", scanner.status.identity.serial, scanner.counters.faults,
                           scanner.counters.gaps, scanner.counters.starts_again, scanner.counters.quits));
  }
  file.print(fmt::format("cpu {}\n", share));
  return measuring ? 0 : 1;
}

}  // namespace
}  // namespace submapd::driver

int main(int argc, char** argv) {
  CLI::App app("Runs the driver with two scanners and writes what it saw", "scanners_soak");
  double seconds = 10.0;
  std::string out;
  std::array<std::string, 2> serials = {"00900001", "00900002"};
  app.add_option("--seconds", seconds, "From the first scan of both on")->capture_default_str();
  auto* const out_option = app.add_option("--out", out, "File for what was seen");
  bool bare = false;
  app.add_flag("--bare", bare,
               "Reads bytes through libusb and does nothing with them: the floor of the "
               "processor time. Wants hokuyo-sim --boot 0")
      ->excludes(out_option);
  submapd::driver::UsbOptions usb;
  app.add_option("--transfer-bytes", usb.transfer_bytes, "Of one USB transfer, a multiple of 64")
      ->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  if (bare) {
    return submapd::driver::run_bare(seconds, usb);
  }
  return submapd::driver::run(seconds, out, serials, usb);
}
