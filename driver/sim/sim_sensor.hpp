// One emulated UTM-30LX: bytes in, bytes out, in a time that the caller advances.
//
// No I/O and no threads: a front (umockdev, USB/IP, pseudo-terminal, or a test in virtual time) feeds it what the host
// writes and asks what is due. All state is per object, so any number of sensors may run side by side. All times are
// nanoseconds of one true clock (CLOCK_MONOTONIC for the fronts); they never go back. Thread-compatible.
//
// Behaviour follows the SCIP 2.0 manual and captures of a UTM-30LX: replies come on the 25 ms scan grid except in time
// mode, replies to the laser's commands have that sensor's statuses (BM 02 when on, CR 04), the clock has 24 bits of
// milliseconds. The truth of each scan goes to a side channel.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <random>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "driver/sim/fault_script.hpp"
#include "driver/sim/range_source.hpp"

namespace submapd::driver {

struct SimSensorOptions {
  std::string serial = "00903971";
  std::string product = "SOKUIKI Sensor TOP-URG UTM-30LX";
  std::string model = "UTM-30LX(Hokuyo Automatic Co.,Ltd.)";
  std::string firmware = "P.1.05(17/Apr./2009)";
  std::int64_t boot_ns = 1'500'000'000;         // from power-on until the first command is heard
  double clock_ppm = 0.0;                       // the crystal's error; rotor and stamps run from it
  std::uint32_t clock_start_ms = 0;             // of the 24-bit counter at power-on, to reach its wrap soon
  std::int64_t grid_phase_ns = 0;               // true time of the first turn's step 0 after power-on
  std::int64_t stamp_to_step0_ns = 0;           // step 0 happens this long after the instant of the stamp
  std::int64_t scan_latency_ns = 1'000'000;     // from the last beam to the first byte
  std::int64_t time_mode_latency_ns = 300'000;  // from a TM1 request to its reply
  std::int64_t usb_frame_ns = 0;                // bytes appear on this grid of the true clock; 0: at once
  std::size_t packets_per_frame = 19;           // full speed carries at most this many 64-byte packets in 1 ms
  std::uint32_t scans_per_me_message = 1;       // 2: ME with all beams does not fit 25 ms, as on firmware P.1.05
  bool reboot_supported = false;                // RB
  bool scip11 = false;                          // starts in SCIP 1.1 as a URG-04LX does, until SCIP2.0 is sent
  bool abnormal = false;                        // answers 0L from power-on
  double fault_rate = 0.0;                      // share of scans with a random byte fault of detectable kind
  double damage_rate = 0.0;                     // share of scans with kDamagedBytes
  std::uint64_t seed = 1;                       // of all random choices
  std::vector<SimFault> script;
};

// What the host will see, in order.
struct SimOutput {
  enum class Kind : std::uint8_t { kBytes, kStall, kOverflow, kUnplug, kReplug };
  Kind kind = Kind::kBytes;
  std::int64_t due_ns = 0;
  std::vector<std::uint8_t> bytes;
  bool message_end = false;  // a short packet follows the last byte, if it is not already at a packet's edge
};

// What really happened in one scan that was measured while the stream ran.
struct SimScanTruth {
  std::uint64_t rotation = 0;      // turn of the rotor since power-on
  std::uint64_t epoch = 0;         // restarts of the clock so far
  std::int64_t first_beam_ns = 0;  // true time of step 0
  std::uint32_t stamp_ms = 0;      // as sent, 24 bits
  std::uint64_t ranges_hash = 0;   // hash_ranges() of the values sent for steps asked for, before any damage
  std::uint32_t faults = 0;        // bit SimFaultKind: what hit this scan
  std::int64_t sent_ns = 0;        // when its last byte was there for the host, if it was sent
  bool sent = true;                // false: skipped, or nobody could hear it
};

// FNV-1a over the values as little-endian 32-bit words.
[[nodiscard]] std::uint64_t hash_ranges(std::span<const std::uint32_t> range_mm);

class SimSensor {
 public:
  using TruthSink = std::function<void(const SimScanTruth&)>;
  static constexpr std::size_t kSteps = 1081;
  static constexpr double kScanPeriod_ns = 25e6;
  static constexpr double kMeasuring_ns = 1080.0 / 1440.0 * 25e6;  // step 0 to step 1080

  // REQUIRES: source. `truth` may be empty; it is called while the sensor is advanced.
  SimSensor(SimSensorOptions options, std::unique_ptr<RangeSource> source, TruthSink truth);

  // Power on at now_ns: everything forgotten, the clock at its start.
  void power_on(std::int64_t now_ns);
  // Bytes from the host. Not heard while booting, silent or unplugged.
  void receive(std::int64_t now_ns, std::span<const std::uint8_t> bytes);
  // The host resets the port (libusb_reset_device).
  void usb_reset(std::int64_t now_ns);

  // The next thing due at or before now_ns, in order of time; nothing if there is none.
  [[nodiscard]] std::optional<SimOutput> take(std::int64_t now_ns);
  // When to ask again; nothing happens before it unless bytes are received.
  [[nodiscard]] std::int64_t next_event_ns() const;

  [[nodiscard]] std::uint64_t scans_sent() const { return scans_sent_; }
  [[nodiscard]] std::uint64_t faults_injected(SimFaultKind kind) const {
    return faults_injected_[static_cast<std::size_t>(kind)];
  }
  // The 24-bit counter at that true time.
  [[nodiscard]] std::uint32_t device_ms(std::int64_t now_ns) const;

 private:
  enum class State : std::uint8_t { kBooting, kIdle, kLaserOn, kStreaming, kTimeMode };
  struct Command {
    std::string text;  // with its string, without LF
    std::int64_t ready_ns = 0;
    bool direct = false;  // answered at ready_ns and not on the scan grid
  };
  struct Stream {
    std::string head;    // command without its number of scans
    std::string suffix;  // ";string" or nothing
    char kind = 'D';     // D, S or E
    int first = 0;
    int last = 0;
    int cluster = 1;
    int interval = 0;
    int remaining = 0;  // of a limited stream
    bool limited = false;
    int skipped = 0;  // turns since the last scan sent
    std::uint64_t scans = 0;
  };

  void run_until(std::int64_t now_ns);
  void tick();
  void finish_boot(std::int64_t now_ns);
  void restart(std::int64_t now_ns, std::int64_t dark_ns);
  [[nodiscard]] std::int64_t step0_ns(std::uint64_t rotation) const;
  [[nodiscard]] std::int64_t tick_ns() const;

  // Commands (sim_commands.cpp).
  void execute(const Command& command, std::int64_t now_ns);
  void execute_scip11(const std::string& text, std::int64_t now_ns);
  [[nodiscard]] std::string status_of(const std::string& name, const std::string& arguments, std::int64_t now_ns);
  [[nodiscard]] std::string start_stream(const std::string& text, const std::string& suffix, Stream& stream) const;
  void append_parameters(std::string& reply, const std::string& echo, std::int64_t now_ns) const;
  [[nodiscard]] bool heard_through_hang(const std::string& name);
  [[nodiscard]] std::string time_mode_status(const std::string& name);

  // Scans (sim_scans.cpp).
  void stream_turn(std::int64_t now_ns);
  [[nodiscard]] bool stream_trouble(std::int64_t now_ns);
  void send_scan(const std::string& echo, const char* status, const Stream& stream, std::int64_t now_ns);
  void apply_faults(std::vector<std::uint8_t>& frame, SimScanTruth& truth, std::int64_t now_ns);
  void begin_fault(const SimFault& fault, SimScanTruth& truth, std::int64_t now_ns);
  void note(SimFaultKind kind, SimScanTruth& truth);

  void send(std::string_view message, std::int64_t now_ns);
  void send_bytes(std::span<const std::uint8_t> bytes, std::int64_t now_ns, bool message_end);
  void send_event(SimOutput::Kind kind, std::int64_t due_ns);

  SimSensorOptions options_;
  std::unique_ptr<RangeSource> source_;
  TruthSink truth_;
  std::mt19937_64 random_;

  std::int64_t powered_ns_ = 0;
  std::int64_t clock_zero_ns_ = 0;
  std::uint32_t clock_start_ms_ = 0;
  std::uint64_t epoch_ = 0;
  std::uint64_t rotation_ = 0;  // whose end is the next tick
  State state_ = State::kBooting;
  Stream stream_;
  std::string line_;
  std::deque<Command> commands_;
  std::deque<SimOutput> outputs_;
  std::int64_t last_due_ns_ = 0;
  std::int64_t sending_takes_ns_ = 0;

  bool scip11_ = false;
  bool abnormal_ = false;
  bool trouble_ = false;
  int reboots_asked_ = 0;
  int fault_mode_ = 10;  // of DB
  std::optional<SimRemedy> hang_;
  std::int64_t silent_until_ns_ = 0;
  std::int64_t away_until_ns_ = 0;  // unplugged

  std::optional<std::int64_t> first_scan_ns_;
  std::size_t next_fault_ = 0;      // of the script
  std::vector<SimFault> damaging_;  // scripted faults that still have scans to hit
  std::uint64_t scans_sent_ = 0;
  std::array<std::uint64_t, 32> faults_injected_{};
  std::vector<std::uint32_t> range_mm_;
  std::vector<std::uint32_t> intensity_;
};

}  // namespace submapd::driver
