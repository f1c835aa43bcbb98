// What operator and engineer use on a cart that rolls: the cloud, the live picture, one button, triggers; and what
// anybody on the network or at the socket may try meanwhile.
#include <gtest/gtest.h>
#include <linux/input.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>

#include <cstring>
#include <lcm/lcm-cpp.hpp>
#include <random>

#include "daemon/submap_publisher.hpp"
#include "proto/lcm_message.hpp"
#include "submapd/command_t.hpp"
#include "submapd/graph_t.hpp"
#include "submapd/pose_t.hpp"
#include "submapd/trigger_t.hpp"
#include "tests/process/saved_map.hpp"
#include "tests/support/random_submap.hpp"

namespace submapd::test {
namespace {

constexpr const char* kUrl = "udpm://239.255.76.67:7667?ttl=0";

// Walls, floor and ceiling as the simulated office has them.
void check_cloud(const DaemonRig& rig, const std::filesystem::path& run) {
  const std::string text = text_in(run / "maps" / "hall" / "cloud.ply");
  std::size_t count = 0;
  ASSERT_EQ(std::sscanf(text.c_str() + text.find("element vertex"), "element vertex %zu", &count), 1);
  const std::size_t begin = text.find("end_header\n") + 11;
  ASSERT_EQ(text.size(), begin + 20 * count);
  ASSERT_GT(count, 100'000U);
  const tools::World world = tools::office_world();
  const Pose2 to_world = world_from_map(rig, run);
  std::size_t off = 0;
  std::size_t floor = 0;
  std::size_t ceiling = 0;
  std::array<std::size_t, 2> walls{};  // below and above a man's height
  double floor_sum_m = 0.0;
  for (std::size_t i = 0; i < count; ++i) {
    std::array<float, 3> point{};
    std::memcpy(point.data(), text.data() + begin + 20 * i, 12);
    const double z = static_cast<double>(point[2]);
    if (std::abs(z) < 0.08) {
      ++floor;
      floor_sum_m += z;
    } else if (std::abs(z - 2.8) < 0.08) {
      ++ceiling;
    } else if (world.clearance(transform(to_world, {static_cast<double>(point[0]), static_cast<double>(point[1])}),
                               1.0) < 0.12) {
      ++walls[z < 1.7 ? 0 : 1];
    } else {
      ++off;
    }
  }
  EXPECT_LT(off, count / 100) << "of " << count;
  EXPECT_GT(floor, count / 40) << "the scanner is blind straight below";
  EXPECT_GT(ceiling, count / 20);
  EXPECT_GT(walls[0], count / 20);
  EXPECT_GT(walls[1], count / 20);
  EXPECT_NEAR(floor_sum_m / static_cast<double>(floor), 0.0, 0.005);
}

TEST(FieldTest, CloudPictureButtonHookAndTriggers) {
  DaemonRig rig;
  const std::filesystem::path button = rig.scratch() / "button";
  const std::filesystem::path told = rig.scratch() / "told";
  const std::filesystem::path hook = rig.scratch() / "hook";
  ASSERT_EQ(::mkfifo(button.c_str(), 0600), 0);
  std::ofstream(hook) << "#!/bin/sh\necho \"$SUBMAPD_EVENT $SUBMAPD_MAP $SUBMAPD_MESSAGE\" >>" << told.string() << "\n";
  std::filesystem::permissions(hook, std::filesystem::perms::owner_all);
  std::ofstream(rig.config(), std::ios::app) << "[lcm]\ntriggers = true\n[button]\ndevice = \"" << button.string()
                                             << "\"\nkey = 30\n[hook]\ncommand = \"" << hook.string() << "\"\n";
  rig.start();
  const auto now = [&] { return rig.health(); };
  ASSERT_TRUE(rig.wait_for_health([](const json& h) { return h["state"] == "mapping"; }));

  lcm::LCM others(kUrl);
  trigger_t trigger{};
  trigger.name = "panorama-1";
  EXPECT_EQ(others.publish("CART_TRIGGER", &trigger), 0);
  trigger.name = "../etc";
  EXPECT_EQ(others.publish("CART_TRIGGER", &trigger), 0);
  command_t command{};
  command.command = command_t::PAUSE;
  EXPECT_EQ(others.publish("CART_COMMAND", &command), 0) << "which is not configured";
  EXPECT_TRUE(rig.wait_for_health([](const json& h) { return h["inputs"]["taken"] == 1 && h["inputs"]["bad"] == 1; }));

  ASSERT_TRUE(rig.wait_for_submaps(2));
  const std::string picture = (rig.scratch() / "live.png").string();
  EXPECT_EQ(rig.run({SUBMAPCTL, "get-map", picture, "--socket", rig.socket()}), 0);
  EXPECT_TRUE(text_in(picture).starts_with("\x89PNG\r\n"));

  const json saved = save_map(rig, {{"name", "hall"}, {"cloud", true}});
  ASSERT_EQ(saved["state"], "done") << saved;
  const std::filesystem::path run = rig.runs()[0];
  EXPECT_EQ(saved["cloud_bytes"], std::filesystem::file_size(run / "maps" / "hall" / "cloud.ply"));
  check_cloud(rig, run);
  const json report = json::parse(text_in(run / "maps" / "hall" / "report.json"), nullptr, false);
  EXPECT_EQ(report.value("format", 0), 1);
  EXPECT_GT(report["walls"]["pieces"], 100);
  EXPECT_LT(report["walls"]["sigma_p50_m"], 0.03);
  EXPECT_NE(text_in(run / "maps" / "hall" / "marks.csv").find("\npanorama-1,"), std::string::npos);

  const int pedal = ::open(button.c_str(), O_WRONLY | O_CLOEXEC);
  ASSERT_GE(pedal, 0);
  const auto press = [&](std::int32_t value, std::uint16_t code) {
    input_event event{};
    event.type = EV_KEY;
    event.code = code;
    event.value = value;
    EXPECT_EQ(::write(pedal, &event, sizeof event), static_cast<ssize_t>(sizeof event));
  };
  press(1, 31);  // another key
  press(1, 30);
  press(2, 30);  // held
  press(0, 30);
  EXPECT_TRUE(rig.wait_for_health([&](const json&) {
    return text_in(told).find("map-saved " + (run / "maps" / "map-").string()) != std::string::npos;
  }));
  const std::string heard = text_in(told);
  EXPECT_EQ(std::count(heard.begin(), heard.end(), '\n'), 4) << "two of each map:\n" << heard;
  ::close(pedal);

  // A hook that hangs, and a key that cannot change while it runs.
  std::ofstream(hook) << "#!/bin/sh\nsleep 60 & sleep 60\n";
  std::string file = text_in(rig.config());
  std::ofstream(rig.config()) << file << "longest = 1\n[filter]\nparticles = 7\n";
  rig.signal(SIGHUP);
  ASSERT_TRUE(rig.wait_for_health([&](const json&) {
    return rig.messages().find("taken: hook.longest") != std::string::npos &&
           rig.messages().find("restarted: filter.particles") != std::string::npos;
  }));
  EXPECT_EQ(save_map(rig, {{"name", "again"}})["state"], "done");
  EXPECT_TRUE(rig.wait_for_health([](const json& h) { return h["control"]["hook_failed"] == 2; })) << now();
  std::ofstream(rig.config()) << "[filter]\nparticles = 0\n";
  rig.signal(SIGHUP);
  EXPECT_TRUE(rig.wait_for_health(
      [&](const json&) { return rig.messages().find("nothing is changed: ") != std::string::npos; }));

  const json health = now();
  EXPECT_EQ(health["mapper"]["missing"], 0);
  EXPECT_EQ(health["mapper"]["skipped"], 0);
  EXPECT_GT(health["scanners"]["vertical"]["clock_error_ms"], 0.0);
  RecordProperty("longest_turn_ms", health["control"]["longest_turn_ms"].dump());
  EXPECT_EQ(rig.end(SIGTERM), 0);
}

// Everything the daemon listens to, flooded with garbage, forged and foreign messages, while the cart rolls.
TEST(FieldTest, NothingOnTheNetworkIsTrusted) {
  DaemonRig rig;
  std::ofstream(rig.config(), std::ios::app) << "[lcm]\ntriggers = true\ncommands = true\n";
  rig.start();
  ASSERT_TRUE(rig.wait_for_submaps(1));
  const JournalContents journal = DaemonRig::journal_of(rig.runs()[0]);
  lcm::LCM others(kUrl);

  // Another run's sub-maps, and ours as somebody else would have them.
  for (const bool ours : {false, true}) {
    FinishedSubmap submap = random_submap(5, {journal.cart, ours ? journal.run : Uuid::from_seed(9, 9), 3}, {});
    SubmapPublisher publisher(others, SubmapPublisherOptions{Channels(), std::chrono::microseconds(2000)});
    EXPECT_TRUE(publisher.publish(submap, Sha256{}).ok());
  }
  EXPECT_TRUE(rig.wait_for_health(
      [](const json& h) { return h["optimizer"]["foreign"] >= 1 && h["optimizer"]["forged"] >= 1; }));
  // Poses and a graph in our name: nobody listens.
  pose_t pose{};
  put_uuid(journal.cart, pose.cart);
  put_uuid(journal.run, pose.run);
  pose.map_from_base[0] = 1000.0;
  EXPECT_EQ(others.publish("CART_POSE", &pose), 0);
  graph_t graph{};
  put_uuid(journal.cart, graph.cart);
  put_uuid(journal.run, graph.run);
  graph.version = 1'000'000;
  graph.parts = 1;
  EXPECT_EQ(others.publish("CART_GRAPH", &graph), 0);

  const std::int64_t before = rig.health()["mapper"]["scans"];
  std::mt19937 random(1);
  std::vector<std::uint8_t> garbage(3000);
  constexpr const char* kChannels[] = {"CART_SUBMAP", "CART_GRAPH",   "CART_POSE",    "CART_SCAN_H", "CART_SCAN_V",
                                       "CART_HEALTH", "CART_TRIGGER", "CART_COMMAND", "OTHER"};
  // 20 000 a second for three seconds, in bursts of 20.
  const auto start = std::chrono::steady_clock::now();
  for (int burst = 0; burst < 3000; ++burst) {
    for (int i = 0; i < 20; ++i) {
      for (int k = 0; k < 8; ++k) garbage[random() % garbage.size()] = static_cast<std::uint8_t>(random());
      (void)others.publish(kChannels[random() % std::size(kChannels)], garbage.data(),
                           static_cast<unsigned>(random() % garbage.size()));
    }
    std::this_thread::sleep_until(start + std::chrono::milliseconds(burst));
  }
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
  RecordProperty("messages_a_second", std::to_string(static_cast<int>(60'000 / took.count())));
  EXPECT_TRUE(rig.wait_for_health([&](const json& h) {
    return h["mapper"]["scans"] > before + 100 && h["inputs"]["bad"] > 0 && h["optimizer"]["bad"] > 0;
  })) << rig.health();
  EXPECT_EQ(rig.health()["inputs"]["taken"], 0);
  EXPECT_TRUE(rig.wait_for_submaps(4)) << "sub-maps go on";
  EXPECT_TRUE(rig.wait_for_health([](const json& h) { return h["optimizer"]["submaps"] >= 4; }));
  EXPECT_EQ(rig.health()["state"], "mapping");
  expect_good_map(rig);
  EXPECT_EQ(rig.end(SIGTERM), 0);
}

// A thousand clients that do what clients should not.
TEST(FieldTest, HostileClientsKeepNobodyOut) {
  DaemonRig rig;
  rig.start();
  ASSERT_TRUE(rig.wait_for_health([](const json& h) { return h["state"] == "mapping"; }));
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  rig.socket().copy(address.sun_path, sizeof address.sun_path - 1);
  std::mt19937 random(1);
  std::vector<int> open;
  for (int i = 0; i < 1000; ++i) {
    const int fd = ::socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    ASSERT_GE(fd, 0);
    if (::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
      ::close(fd);  // the queue is full of their like
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      continue;
    }
    std::string packet(i % 5 == 0 ? 60'000 : 100, '\0');
    for (char& c : packet) c = static_cast<char>(random());
    if (i % 5 == 1) packet = R"({"verb":"health"})";
    if (i % 5 == 2) packet = R"({"verb":"save-map","name":")";
    if (i % 5 == 3) packet = std::string(4000, '[');
    const int times = i % 7 == 0 ? 200 : 1;  // and never reads
    for (int k = 0; k < times; ++k) (void)::send(fd, packet.data(), packet.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (i % 2 == 0) {
      open.push_back(fd);
    } else {
      ::close(fd);
    }
  }
  EXPECT_TRUE(rig.wait_for_health([](const json& h) { return h["state"] == "mapping"; }, 5)) << "the operator gets in";
  for (const int fd : open) ::close(fd);
  const json health = rig.health();
  EXPECT_GT(health["control"]["turned_away"].get<int>() + health["control"]["shut_out"].get<int>(), 100);
  RecordProperty("longest_turn_ms", health["control"]["longest_turn_ms"].dump());
  ASSERT_TRUE(rig.wait_for_submaps(1));
  expect_good_map(rig);
  EXPECT_EQ(rig.end(SIGTERM), 0);
}

}  // namespace
}  // namespace submapd::test
