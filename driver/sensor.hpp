// One scanner from plugging in to streaming, and back to streaming after whatever goes wrong.
//
// Speaks SCIP 2.0 over a ByteLink: waits patiently until the sensor answers, asks who it is, has its role decided,
// measures its clock, starts the stream, and watches it. When scans fail to come it climbs a ladder: MD again after 250
// ms, QT and MD after 500 ms, RS after 1 s, a reset of the USB device after 3 s, then start-up again for ever with
// growing pauses.
//
// Threads: all of LinkClient on the event thread, as are the calls to SensorOwner and SensorSink. counters() and
// ask_for_time() may be called from any thread. Between on_bytes() and SensorSink::on_scan() nothing allocates, locks
// or logs. Sources: SCIP 2.0 specification C-42-03320B; the order of the start-up is what drivers in the field learnt.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <string_view>

#include "driver/link.hpp"
#include "driver/scip/parser.hpp"
#include "driver/sensor_roles.hpp"

namespace submapd::driver {

inline constexpr std::int64_t kMillisecond_ns = 1'000'000;

enum class SensorState : std::uint8_t {
  kClosed,      // no line
  kStarting,    // asked, and not yet measuring
  kUnassigned,  // answers, but the configuration gives it no role
  kSyncing,     // its clock is measured; no scans meanwhile
  kStreaming,
  kRecovering,  // scans should come and do not
  kTrouble,     // says that it is broken, or does not answer at all; asked again with growing pauses
};
[[nodiscard]] std::string_view name(SensorState state);

// What came of a trial of ME over all beams, which some firmware damages or cannot keep up with.
struct SelfTest {
  static constexpr int kScans = 100;
  int scans = 0;
  int damaged = 0;
  int lost = 0;  // turns without a whole scan, between two with one
  [[nodiscard]] bool passed() const { return scans == kScans && damaged == 0 && lost == 0; }
};

struct SensorStatus {
  SensorState state = SensorState::kClosed;
  SensorIdentity identity;            // empty until it answered
  std::string words;                  // for a person: what is the matter and what helps; empty if all is well
  std::optional<SelfTest> self_test;  // if one was asked for and is over
};

// One question about the sensor's clock: it read device_ms at some time between these two.
struct TimeSample {
  std::int64_t sent_ns = 0;
  std::int64_t received_ns = 0;
  std::uint32_t device_ms = 0;  // 24 bits
};

struct SensorCounters {
  std::uint64_t scans = 0;
  std::uint64_t stale_scans = 0;   // of a stream that was ended
  std::uint64_t faults = 0;        // damaged frames while streaming
  std::uint64_t gaps = 0;          // 75 ms without a scan
  std::uint64_t starts_again = 0;  // the rungs of the ladder
  std::uint64_t quits = 0;
  std::uint64_t sensor_resets = 0;
  std::uint64_t usb_resets = 0;
  std::uint64_t troubles = 0;  // 0L, hardware trouble, trouble in words
};

// Takes what a scanner in its role measures. Valid while the sensor has that role.
class SensorSink {
 public:
  virtual void on_scan(const scip::ScanData& scan) noexcept = 0;
  virtual void on_damaged_scan() noexcept = 0;
  virtual void on_time(const TimeSample& sample) noexcept = 0;
  // The sensor's clock starts anew: RS was sent, or the line was closed in between.
  virtual void on_new_clock() noexcept = 0;
  // True if its clock was measured since this program started: the stream need not wait for that.
  [[nodiscard]] virtual bool knows_clock() const noexcept = 0;

 protected:
  ~SensorSink() = default;
};

struct SensorAssignment {
  SensorSink* sink = nullptr;
  bool intensity = false;  // ME in place of MD
  bool self_test = false;  // once, before the first stream. A person's command, never done unasked: ME may hang it
};

class SensorOwner {
 public:
  // Who is this? The error's message becomes the sensor's words.
  virtual Expected<SensorAssignment> assign(const SensorIdentity& identity) = 0;
  // The state or the words changed. The reference is valid during the call. May be called from within on_bytes().
  virtual void on_status(const SensorStatus& status) noexcept = 0;

 protected:
  ~SensorOwner() = default;
};

struct SensorOptions {
  int first_samples = 150;  // of the clock before the first stream, some 20 ms apart
  int later_samples = 20;   // at a standstill
  std::uint64_t seed = 1;   // of the pauses between samples
};

class Sensor final : public LinkClient, private scip::Listener {
 public:
  // REQUIRES: owner outlives the sensor.
  Sensor(SensorOptions options, std::string port, SensorOwner& owner);
  Sensor(const Sensor&) = delete;
  Sensor& operator=(const Sensor&) = delete;
  ~Sensor() = default;

  void on_open(ByteLink& link, std::int64_t now_ns) noexcept override;
  void on_close(std::int64_t now_ns) noexcept override;
  void on_stop(std::int64_t now_ns) noexcept override;
  void on_bytes(std::span<const std::uint8_t> bytes, std::int64_t stamp_ns, std::uint64_t offset) noexcept override;
  void on_fault(LinkFault fault, std::int64_t now_ns) noexcept override;
  void on_time(std::int64_t now_ns) noexcept override;
  [[nodiscard]] std::int64_t next_time_ns() const noexcept override;

  // The cart stands still: stop the stream for a moment and measure the clock again.
  void ask_for_time() noexcept { time_wanted_.store(true, std::memory_order_relaxed); }

  [[nodiscard]] const SensorStatus& status() const { return status_; }  // event thread only
  [[nodiscard]] SensorCounters counters() const noexcept;

 private:
  enum class Step : std::uint8_t {
    kClosed,
    kListen,      // lets old bytes run out
    kQuit,        // QT, until it is answered
    kScip2,       // SCIP2.0, for a sensor that answers in SCIP 1.1
    kTimeOff,     // TM2
    kQuitAgain,   // the first QT may have been ignored
    kVersion,     // VV
    kParameters,  // PP
    kHealth,      // II
    kReset,       // RS
    kReboot,      // RB, twice
    kTimeOn,      // TM0
    kTimeAsk,     // TM1
    kTimePause,
    kTimeEnd,   // TM2
    kSelfTest,  // ME, for SelfTest::kScans
    kLaser,     // BM
    kStart,     // MD, ME
    kStream,
    kWait,  // trouble: everything again after a pause
    kIdle,  // no role: nothing more to do
  };
  // Where the sequence of steps goes after both QT.
  enum class Goal : std::uint8_t { kStartUp, kRestart, kResetSensor, kMeasureClock };

  // Steps (sensor_steps.cpp).
  void enter(Step step, std::int64_t now_ns);
  void ask(std::string_view command, std::int64_t timeout_ns);
  void answered(const scip::Frame& frame, std::span<const scip::Parameter> parameters);
  void answered_health(std::span<const scip::Parameter> parameters);
  void answered_laser(const scip::ReplyStatus& status);
  void timed_out();
  void after_quit();
  void after_health();
  void take_identity(std::span<const scip::Parameter> parameters);
  void next_sample();
  void ask_scans(char data, std::int64_t timeout_ns);
  void test_scan(std::uint32_t stamp_ms);
  void end_self_test();
  void trouble(std::string words);
  void refused(std::string_view command, const scip::ReplyStatus& status);

  // The watch over the stream (sensor.cpp).
  void climb();
  void reset_line(std::string words);
  void begin(Goal goal, Step first);
  void tell(SensorState state, std::string words);
  [[nodiscard]] bool abnormal(const scip::ReplyStatus& status) const;

  // scip::Listener
  void on_scan(const scip::ScanData& scan) noexcept override;
  void on_stale_scan(const scip::ScanData& scan) noexcept override;
  void on_stream_start(const scip::Frame& frame) noexcept override;
  void on_stream_status(const scip::Frame& frame) noexcept override;
  void on_time(const scip::Frame& frame, std::uint64_t time) noexcept override;
  void on_reply(const scip::Frame& frame, std::span<const scip::Parameter> parameters) noexcept override;
  void on_fault(const scip::Fault& fault) noexcept override;

  using Counter = std::atomic<std::uint64_t>;
  static void count(Counter& counter) noexcept { counter.fetch_add(1, std::memory_order_relaxed); }

  SensorOptions options_;
  std::string port_;
  SensorOwner& owner_;
  std::mt19937_64 random_;
  ByteLink* link_ = nullptr;
  std::unique_ptr<scip::Parser> parser_;
  std::int64_t now_ns_ = 0;  // of the call that is being served

  Step step_ = Step::kClosed;
  Goal goal_ = Goal::kStartUp;
  std::int64_t deadline_ns_ = kNever_ns;  // of the step
  int tries_ = 0;                         // of the step
  scip::Command asked_;                   // whose answer the step waits for
  std::int64_t asked_ns_ = 0;
  std::uint32_t tag_ = 0;

  SensorStatus status_;
  std::optional<SensorAssignment> assignment_;
  bool scip11_ = false;   // it spoke SCIP 1.1 and was switched
  bool silent_ = false;   // nothing was heard through a whole start-up
  int first_step_ = 0;    // AMIN
  int last_step_ = 1080;  // AMAX
  int samples_left_ = 0;
  int samples_lost_ = 0;
  SelfTest test_;                    // under way
  std::uint32_t test_stamp_ms_ = 0;  // of its last scan
  std::int64_t started_ns_ = 0;      // this start-up, for its patience
  std::int64_t pause_ns_ = 0;        // before everything is tried again
  std::int64_t laser_since_ns_ = 0;
  int resets_in_a_row_ = 0;  // without a scan between them

  std::int64_t heard_ns_ = 0;  // the last bytes
  bool watching_ = false;      // scans are due
  std::int64_t alive_ns_ = 0;  // the last scan, or when the first was asked for
  std::size_t rung_ = 0;       // of the ladder
  std::atomic<bool> time_wanted_{false};

  Counter scans_{0}, stale_scans_{0}, faults_{0}, gaps_{0}, starts_again_{0}, quits_{0}, sensor_resets_{0},
      usb_resets_{0}, troubles_{0};
};

}  // namespace submapd::driver
