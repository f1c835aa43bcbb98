// What others on the cart send over LCM while it rolls: wheel odometry, good and bad; an operator's commands.
#include <gtest/gtest.h>

#include <lcm/lcm-cpp.hpp>
#include <limits>

#include "proto/lcm_message.hpp"
#include "proto/scan_conversion.hpp"
#include "submapd/command_t.hpp"
#include "submapd/odometry_t.hpp"
#include "submapd/reply_t.hpp"
#include "tests/process/saved_map.hpp"
#include "tools/log/log_reader.hpp"

namespace submapd::test {
namespace {

constexpr const char* kUrl = "udpm://239.255.76.67:7667?ttl=0";
constexpr Pose2 kWheelsStart{3.0, -2.0, 1.0};  // the wheels' frame is not the map's

// Wheels that measure fifty times a second where the cart is, by the system's clock.
class Wheels {
 public:
  explicit Wheels(const DaemonRig& rig) : rig_(rig) {
    thread_ = std::jthread([this](const std::stop_token& stop) {
      lcm::LCM lcm(kUrl);
      auto next = std::chrono::steady_clock::now();
      while (!stop.stop_requested()) {
        next += std::chrono::milliseconds(20);
        std::this_thread::sleep_until(next);
        if (!slip_.load()) at_ns_ = driver::monotonic_now_ns();
        send(lcm, compose(kWheelsStart, rig_.truth(at_ns_)));
      }
    });
  }
  static void send(lcm::LCM& lcm, const Pose2& pose, const Uuid& cart = {}, std::int64_t ago_us = 0) {
    odometry_t message{};
    message.utime = (driver::monotonic_now_ns() + RunClock::system_offset_ns()) / 1000 - ago_us;
    put_uuid(cart, message.cart);
    put_pose(pose, message.odom_from_base);
    EXPECT_EQ(lcm.publish("CART_ODOMETRY", &message), 0);
  }
  // They turn without effect, or stand while the cart slides: the same pose again and again.
  void slip(bool on) { slip_.store(on); }

 private:
  const DaemonRig& rig_;
  std::atomic<bool> slip_{false};
  std::int64_t at_ns_ = 0;
  std::jthread thread_;
};

struct RecordedOdometry {
  std::size_t scans = 0;
  std::size_t with = 0;
  double worst_m = 0.0;  // from where the wheels really had the cart at the first beam
};
RecordedOdometry odometry_in(const std::filesystem::path& log, const DaemonRig& rig) {
  RecordedOdometry found;
  auto reader = tools::open_log(
      log.string(), [&](std::string_view channel, std::span<const std::byte> data) -> Expected<std::optional<Scan>> {
        if (channel != "CART_SCAN_H") return std::optional<Scan>{};
        Expected<ScanMessage> message = decode_scan(data);
        if (!message) return failure(message.error());
        ++found.scans;
        if (message->scan.odometry) {
          ++found.with;
          const Pose2 truth = compose(kWheelsStart, rig.truth(message->origin.mono_ns));
          found.worst_m = std::max(found.worst_m, (message->scan.odometry->translation() - truth.translation()).norm());
        }
        return std::optional<Scan>(std::move(message->scan));
      });
  while (reader) {
    const auto scan = (*reader)->next();
    if (!scan || !*scan) break;
  }
  return found;
}

void expect_the_same_replayed(DaemonRig& rig) {
  const std::filesystem::path run = rig.runs()[0];
  const std::filesystem::path again = rig.scratch() / "replay";
  ASSERT_EQ(rig.run({SUBMAPCTL, "replay", run.string(), "--out", again.string(), "--config", rig.config()}), 0);
  std::size_t submaps = 0;
  for (const auto& entry : std::filesystem::directory_iterator(run / "submaps")) {
    ++submaps;
    EXPECT_EQ(bytes_of(entry.path()), bytes_of(again / "submaps" / entry.path().filename())) << entry.path();
  }
  EXPECT_GE(submaps, 3U);
  EXPECT_FALSE(std::filesystem::exists(again / fmt::format("submaps/{:06}.submap", submaps)));
}

TEST(LcmInputsTest, OdometryReachesTheMapperAndTheRawLog) {
  DaemonRig rig;
  std::ofstream(rig.config(), std::ios::app) << "[lcm]\nodometry = true\n";
  rig.start();
  EXPECT_TRUE(rig.wait_for_health([](const json& h) {
    return h["message"].get<std::string>().find("no odometry") != std::string::npos && h["mapper"]["scans"] > 0;
  })) << "it says that none comes, and maps";
  {
    const Wheels wheels(rig);
    ASSERT_TRUE(rig.wait_for_submaps(3));
    EXPECT_TRUE(rig.wait_for_health([](const json& h) { return h["state"] == "mapping"; }));
    const json health = rig.health();
    EXPECT_GT(health["mapper"]["by_odometry"], 100) << health;
    EXPECT_EQ(health["odometry"]["jumps"], 0);
    expect_good_map(rig);
  }
  ASSERT_EQ(rig.end(SIGTERM), 0);
  const RecordedOdometry recorded = odometry_in(rig.runs()[0] / "raw-0000.lcmlog", rig);
  RecordProperty("worst_mm", std::to_string(1e3 * recorded.worst_m));
  EXPECT_GT(recorded.with, 100U);
  EXPECT_LT(recorded.worst_m, 0.01) << "of the first beam's instant, not of the message before";
  expect_the_same_replayed(rig);
}

TEST(LcmInputsTest, OdometryThatLiesBendsNothingAndReplaysTheSame) {
  DaemonRig rig;
  std::ofstream(rig.config(), std::ios::app) << "[lcm]\nodometry = true\n";
  rig.start();
  Wheels wheels(rig);
  ASSERT_TRUE(rig.wait_for_submaps(1));
  lcm::LCM others(kUrl);
  std::vector<std::uint8_t> garbage(200, 0xED);
  for (int i = 0; i < 500; ++i) {
    (void)others.publish("CART_ODOMETRY", garbage.data(), static_cast<unsigned>(i % 200));
    Wheels::send(others, {std::numeric_limits<double>::quiet_NaN(), 0.0, 0.0});
    Wheels::send(others, {}, Uuid::from_seed(3, 4));
    Wheels::send(others, {}, {}, i % 2 == 0 ? 2'000'000 : -2'000'000);
    if (i % 50 == 0) Wheels::send(others, {1e5 + i, 0.0, 0.0});  // as somewhere else
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  EXPECT_TRUE(rig.wait_for_health([](const json& h) {
    const json& o = h["odometry"];
    return o["bad"] > 500 && o["foreign"] > 250 && o["stale"] > 250 && o["jumps"] >= 10;
  })) << rig.health();
  const int before = rig.health()["mapper"]["by_odometry"];
  EXPECT_TRUE(rig.wait_for_health([&](const json& h) { return h["mapper"]["by_odometry"] > before + 20; }))
      << "the wheels count again";
  wheels.slip(true);
  ASSERT_TRUE(rig.wait_for_submaps(3));
  wheels.slip(false);
  ASSERT_TRUE(rig.wait_for_submaps(4));
  EXPECT_EQ(rig.health()["mapper"]["lost"], 0);
  expect_good_map(rig);
  ASSERT_EQ(rig.end(SIGTERM), 0);
  expect_the_same_replayed(rig);
}

// An operator's panel that has nothing but LCM.
class Panel {
 public:
  Panel() { lcm_.subscribeFunction("CART_REPLY", &Panel::on_reply, this)->setQueueCapacity(100); }
  void send(std::int8_t which, std::int64_t utime, const std::string& name) {
    command_t command{};
    command.utime = utime;
    command.command = which;
    command.name = name;
    EXPECT_EQ(lcm_.publish("CART_COMMAND", &command), 0);
  }
  // All replies to a command, the last of which ends it.
  [[nodiscard]] std::vector<reply_t> replies_to(std::int64_t utime) {
    std::vector<reply_t> found;
    const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(30);
    while (std::chrono::steady_clock::now() < until) {
      if (lcm_.handleTimeout(100) <= 0) continue;
      for (reply_t& reply : std::exchange(heard_, {})) {
        if (reply.command_utime == utime) found.push_back(std::move(reply));
      }
      if (!found.empty() && found.back().state != reply_t::WORKING) return found;
    }
    ADD_FAILURE() << "no end of command " << utime << " after " << found.size() << " replies";
    found.emplace_back();
    return found;
  }

 private:
  static void on_reply(const lcm::ReceiveBuffer* buffer, const std::string&, Panel* self) {
    const Expected<reply_t> reply =
        decode_with_text<reply_t>({static_cast<const std::byte*>(buffer->data), buffer->data_size});
    ASSERT_TRUE(reply.has_value());
    self->heard_.push_back(*reply);
  }
  lcm::LCM lcm_{kUrl};
  std::vector<reply_t> heard_;
};

TEST(LcmInputsTest, APanelThatHasOnlyLcmLearnsHowItsCommandsWent) {
  DaemonRig rig;
  std::ofstream(rig.config(), std::ios::app) << "[lcm]\ncommands = true\n";
  rig.start();
  ASSERT_TRUE(rig.wait_for_submaps(1));
  Panel panel;
  panel.send(command_t::MARK, 10, "door");
  EXPECT_EQ(panel.replies_to(10).back().message, "marked door");
  panel.send(command_t::MARK, 10, "door");  // its reply was lost
  EXPECT_EQ(panel.replies_to(10).back().message, "marked door");
  const int marked = rig.health()["mapper"]["scans"];
  EXPECT_TRUE(rig.wait_for_health([&](const json& h) { return h["mapper"]["scans"] > marked + 4; }));
  panel.send(command_t::SAVE_MAP, 11, "../etc");
  const reply_t refused = panel.replies_to(11).back();
  EXPECT_EQ(refused.state, reply_t::FAILED);
  EXPECT_EQ(refused.reason, reply_t::INPUT);
  panel.send(42, 12, "");
  EXPECT_EQ(panel.replies_to(12).back().reason, reply_t::INPUT);

  panel.send(command_t::SAVE_MAP, 13, "hall");
  const std::vector<reply_t> saved = panel.replies_to(13);
  const std::filesystem::path hall = rig.runs()[0] / "maps" / "hall";
  EXPECT_EQ(saved.front().state, reply_t::WORKING) << "accepted";
  EXPECT_EQ(saved.back().state, reply_t::DONE);
  EXPECT_EQ(saved.back().progress, 100);
  EXPECT_EQ(saved.back().message, "saved " + hall.string());
  EXPECT_EQ(get_uuid(saved.back().run), DaemonRig::journal_of(rig.runs()[0]).run);
  for (std::size_t i = 1; i < saved.size(); ++i) EXPECT_GE(saved[i].progress, saved[i - 1].progress);
  const std::string marks = text_in(hall / "marks.csv");
  EXPECT_EQ(marks.find("\ndoor,"), marks.rfind("\ndoor,")) << "set once:\n" << marks;
  EXPECT_NE(marks.find("\ndoor,"), std::string::npos);
  const auto written = std::filesystem::last_write_time(hall / "MANIFEST");
  panel.send(command_t::SAVE_MAP, 13, "hall");
  EXPECT_EQ(panel.replies_to(13).back().message, saved.back().message) << "the same request, if a reply was lost";
  EXPECT_EQ(std::filesystem::last_write_time(hall / "MANIFEST"), written);
  panel.send(command_t::SAVE_MAP, 14, "hall");
  const std::vector<reply_t> twice = panel.replies_to(14);
  EXPECT_EQ(twice.back().state, reply_t::FAILED) << "there is one of that name";
  EXPECT_EQ(twice.back().message, save_map(rig, {{"name", "hall"}})["message"]) << "in the control socket's words";

  panel.send(command_t::PAUSE, 15, "");
  EXPECT_EQ(panel.replies_to(15).back().message, "paused");
  EXPECT_TRUE(rig.wait_for_health([](const json& h) { return h["state"] == "paused"; }));
  panel.send(command_t::RESUME, 16, "");
  EXPECT_EQ(panel.replies_to(16).back().state, reply_t::DONE);
  EXPECT_EQ(rig.end(SIGTERM), 0);
}

}  // namespace
}  // namespace submapd::test
