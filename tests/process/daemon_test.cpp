// submapd as a whole program: maps what two scanners see, saves the map meanwhile, loses nothing when it is ended or
// killed.
#include <gtest/gtest.h>

#include <lcm/lcm-cpp.hpp>
#include <set>

#include "daemon/run_clock.hpp"
#include "proto/scan_conversion.hpp"
#include "slam/base/sha256.hpp"
#include "slam/output/trajectory_file.hpp"
#include "slam/submap/submap_archive.hpp"
#include "submapd/pose_t.hpp"
#include "tests/process/daemon_rig.hpp"
#include "tools/log/log_reader.hpp"

namespace submapd::test {
namespace {

// The poses on the network.
class PoseListener {
 public:
  PoseListener() : lcm_("udpm://239.255.76.67:7667?ttl=0") {
    EXPECT_TRUE(lcm_.good()) << "no multicast route: run by tests/process/in_own_network.sh";
    lcm_.subscribe("CART_POSE", &PoseListener::on_pose, this)->setQueueCapacity(1000);
    thread_ = std::jthread([this](const std::stop_token& stop) {
      while (!stop.stop_requested()) lcm_.handleTimeout(100);
    });
  }
  // Ends listening.
  [[nodiscard]] std::vector<pose_t> poses() {
    thread_.request_stop();
    thread_.join();
    return poses_;
  }

 private:
  void on_pose(const lcm::ReceiveBuffer* /*buffer*/, const std::string& /*channel*/, const pose_t* pose) {
    poses_.push_back(*pose);
  }
  lcm::LCM lcm_;
  std::vector<pose_t> poses_;  // the thread's while it runs
  std::jthread thread_;
};

class GraphListener {
 public:
  GraphListener() : lcm_("udpm://239.255.76.67:7667?ttl=0") {
    lcm_.subscribeFunction(
        "CART_GRAPH", +[](const lcm::ReceiveBuffer*, const std::string&, GraphListener* self) { self->heard_ = true; },
        this);
  }
  // Handles what has come.
  [[nodiscard]] bool heard() {
    while (lcm_.handleTimeout(0) > 0) {
    }
    return heard_;
  }

 private:
  lcm::LCM lcm_;
  bool heard_ = false;
};

// Stamps and numbers of a channel's scans.
struct LoggedScan {
  std::uint64_t index = 0;
  std::int64_t mono_ns = 0;
};
std::vector<LoggedScan> scans_in(const std::filesystem::path& log, const std::string& wanted) {
  std::vector<LoggedScan> scans;
  std::int64_t mono_ns = 0;
  auto reader = tools::open_log(
      log.string(), [&](std::string_view channel, std::span<const std::byte> data) -> Expected<std::optional<Scan>> {
        if (channel != wanted) return std::optional<Scan>{};
        const Expected<ScanMessage> message = decode_scan(data);
        if (!message) return failure(message.error());
        mono_ns = message->origin.mono_ns;
        scans.push_back({message->scan.index, mono_ns});
        return std::optional<Scan>(message->scan);
      });
  while (reader) {
    const auto scan = (*reader)->next();
    if (!scan || !*scan) break;
  }
  return scans;
}

// Every sub-map of the journal is there with its hash, and nothing else is.
std::size_t check_submaps(const std::filesystem::path& run) {
  std::set<std::string> files;
  for (const auto& entry : std::filesystem::directory_iterator(run / "submaps")) {
    files.insert(entry.path().filename().string());
  }
  std::size_t saved = 0;
  for (const JournalRecord& record : DaemonRig::journal_of(run).records) {
    const auto* const submap = std::get_if<SubmapSaved>(&record.event);
    if (submap == nullptr) continue;
    EXPECT_EQ(submap->index, saved++);
    const std::filesystem::path path = run / "submaps" / fmt::format("{:06}.submap", submap->index);
    const Expected<Sha256> hash = sha256_of_file(path);
    EXPECT_TRUE(hash.has_value() && *hash == submap->hash) << path;
  }
  EXPECT_EQ(files.size(), saved);
  return saved;
}

// The largest distance of the trajectory from the truth, laid on its first pose.
double worst_m(const DaemonRig& rig, const std::filesystem::path& trajectory, const RunClock& clock) {
  const Expected<std::vector<StampedPose>> poses = read_tum(trajectory);
  EXPECT_TRUE(poses.has_value() && poses->size() > 100) << trajectory;
  if (!poses || poses->empty()) return 1e9;
  const auto truth = [&](const StampedPose& p) { return rig.truth(p.stamp_us * 1000 - clock.offset_ns()); };
  const Pose2 world_from_map = compose(truth(poses->front()), inverse(poses->front().pose));
  double worst = 0.0;
  for (const StampedPose& p : *poses) {
    const Pose2 off = between(truth(p), compose(world_from_map, p.pose));
    worst = std::max(worst, std::hypot(off.x, off.y));
  }
  return worst;
}

void check_manifest(const std::filesystem::path& map) {
  const json manifest = json::parse(std::ifstream(map / "MANIFEST"), nullptr, false);
  ASSERT_TRUE(manifest.is_object());
  std::set<std::string> names;
  for (const json& file : manifest["files"]) {
    const std::filesystem::path path = map / file["name"].get<std::string>();
    names.insert(path.filename().string());
    const Expected<Sha256> hash = sha256_of_file(path);
    EXPECT_TRUE(hash.has_value() && hex_of(*hash) == file["sha256"]) << path;
  }
  EXPECT_EQ(names, (std::set<std::string>{"graph.g2o", "map.pgm", "map.png", "map.yaml", "marks.csv", "report.json",
                                          "trajectory.tum"}));
}

json save_map(DaemonRig& rig, const std::string& name, bool force = false) {
  Expected<tools::ControlClient> client = tools::ControlClient::connect(rig.socket());
  if (!client) return json::object();
  Expected<json> reply =
      client->ask({{"verb", "save-map"}, {"name", name}, {"id", name + "-1"}, {"wait", true}, {"force", force}});
  while (reply && tools::text_of(*reply, "state") == "working") reply = client->receive(std::chrono::seconds(30));
  return reply ? *reply : json::object();
}

TEST(DaemonTest, MapsSavesSurvivesAPulledCableAndReplaysBitForBit) {
  DaemonRig rig;
  PoseListener listener;
  rig.start();
  ASSERT_TRUE(rig.wait_for_health([](const json& h) { return h["state"] == "mapping"; }));
  EXPECT_EQ(save_map(rig, "../hall")["reason"], "input");

  ASSERT_TRUE(rig.wait_for_submaps(1));
  EXPECT_EQ(rig.ask({{"verb", "mark"}, {"name", "door"}})["state"], "done");
  ASSERT_TRUE(rig.wait_for_submaps(2));
  const json saved = save_map(rig, "hall");
  EXPECT_EQ(saved["state"], "done") << saved;
  EXPECT_EQ(save_map(rig, "hall")["state"], "done") << "the same request again is the same map";
  EXPECT_EQ(rig.ask({{"verb", "save-map"}, {"name", "hall"}, {"id", "hall-2"}})["state"], "working");
  EXPECT_TRUE(rig.wait_for_health([](const json& h) { return h["state"] == "mapping"; })) << "refused, not stuck";
  const json before = rig.health();
  EXPECT_EQ(before["mapper"]["missing"], 0);
  EXPECT_EQ(before["mapper"]["skipped"], 0);
  EXPECT_EQ(before["recorder"]["raw_lost"], 0);
  EXPECT_EQ(before["message"], "");
  EXPECT_GE(before["optimizer"]["completed"], 1) << "sub-maps come over LCM, not from the archive";
  RecordProperty("scan_ms_p99", before["publisher"]["scan_ms_p99"].dump());

  rig.front->unplug(0);
  EXPECT_TRUE(rig.wait_for_health([](const json& h) { return h["state"] == "degraded"; }));
  rig.front->replug(0);
  EXPECT_TRUE(rig.wait_for_health([&](const json& h) {
    return h["state"] == "mapping" && h["mapper"]["scans"] > before["mapper"]["scans"].get<int>() + 20;
  }));
  EXPECT_EQ(rig.health()["scanners"]["horizontal"]["reconnects"], 1);

  EXPECT_EQ(rig.ask({{"verb", "pause"}})["state"], "done");
  ASSERT_TRUE(rig.wait_for_health([](const json& h) { return h["state"] == "paused"; }));
  // In effect when four looks in a row see the same: the daemon looks ten times a second, the scanners eighty.
  std::int64_t scans = -1;
  int same = 0;
  std::int64_t looked_us = 0;
  EXPECT_TRUE(rig.wait_for_health([&](const json& h) {
    if (std::exchange(looked_us, h["utime_us"].get<std::int64_t>()) == h["utime_us"]) return false;
    same = std::exchange(scans, h["recorder"]["raw_scans"].get<std::int64_t>()) == scans ? same + 1 : 0;
    return same == 4;
  }));
  EXPECT_EQ(rig.ask({{"verb", "resume"}})["state"], "done");
  EXPECT_TRUE(rig.wait_for_health([&](const json& h) { return h["recorder"]["raw_scans"] > scans + 40; }));

  rig.signal(SIGHUP);  // changes nothing
  ASSERT_EQ(rig.end(SIGTERM), 0);
  ASSERT_EQ(rig.runs().size(), 1U);
  EXPECT_NE(rig.messages().find("SIGHUP"), std::string::npos);
  const std::vector<std::string> notified = rig.notify.heard();
  EXPECT_EQ(notified.front(), "READY=1");
  EXPECT_EQ(notified.back(), "STOPPING=1");
  EXPECT_GT(std::count(notified.begin(), notified.end(), "WATCHDOG=1"), 10) << "twice a second";
  EXPECT_TRUE(std::any_of(notified.begin(), notified.end(),
                          [](const std::string& told) { return told.starts_with("STATUS=mapping: "); }));
  const std::filesystem::path run = rig.runs()[0];
  const std::size_t submaps = check_submaps(run);
  EXPECT_GE(submaps, 3U) << "the last one too";
  const JournalContents journal = DaemonRig::journal_of(run);
  ASSERT_TRUE(std::holds_alternative<RunStarted>(journal.records.front().event));
  EXPECT_TRUE(std::holds_alternative<RunEnded>(journal.records.back().event));
  const RunClock clock(std::get<RunStarted>(journal.records.front().event).wall_minus_mono_ns);

  check_manifest(run / "maps" / "hall");
  const double worst = worst_m(rig, run / "maps" / "hall" / "trajectory.tum", clock);
  RecordProperty("worst_m", std::to_string(worst));
  EXPECT_LT(worst, 0.05);

  const std::vector<LoggedScan> logged = scans_in(run / "raw-0000.lcmlog", "CART_SCAN_H");
  const std::vector<pose_t> poses = listener.poses();
  std::set<std::int64_t> sent;
  for (const pose_t& pose : poses) sent.insert(pose.seq);
  EXPECT_GT(logged.size(), 150U);
  EXPECT_GE(sent.size() + 5, logged.size()) << "the network may lose a few";
  EXPECT_LE(sent.size(), logged.size());

  const std::filesystem::path again = rig.scratch() / "replay";
  ASSERT_EQ(rig.run({SUBMAPCTL, "replay", (run / "raw-0000.lcmlog").string(), "--out", again.string(), "--config",
                     rig.config()}),
            0);
  for (std::size_t i = 0; i < submaps; ++i) {
    const std::string name = fmt::format("submaps/{:06}.submap", i);
    EXPECT_EQ(bytes_of(run / name), bytes_of(again / name)) << name;
  }
  EXPECT_FALSE(std::filesystem::exists(again / fmt::format("submaps/{:06}.submap", submaps)));
}

// No multicast route at the start, one later: mapping does not care, and poses and graphs go out as soon as they can.
TEST(DaemonTest, WithoutANetworkItMapsAndRecoversByItself) {
  DaemonRig rig;
  ASSERT_EQ(rig.run({"/bin/sh", "-c", "ip route del 224.0.0.0/4 dev lo"}), 0);
  rig.start();
  EXPECT_TRUE(rig.wait_for_health([](const json& h) {
    return h["state"] == "degraded" && h["message"].get<std::string>().find("network") != std::string::npos;
  }));
  EXPECT_TRUE(rig.wait_for_health([](const json& h) { return h["optimizer"]["submaps"] >= 1; })) << "by the archive";
  EXPECT_EQ(rig.health()["publisher"]["lcm"], false);
  ASSERT_EQ(rig.run({"/bin/sh", "-c", "ip route add 224.0.0.0/4 dev lo"}), 0);
  GraphListener listener;
  EXPECT_TRUE(rig.wait_for_health([](const json& h) { return h["state"] == "mapping"; }));
  EXPECT_TRUE(rig.wait_for_health([&](const json&) { return listener.heard(); })) << "a graph";
  EXPECT_EQ(rig.end(SIGTERM), 0);
}

TEST(DaemonTest, KilledItKeepsFinishedSubmapsAndTheRawLogAndGoesOn) {
  DaemonRig rig;
  rig.start();
  ASSERT_TRUE(rig.wait_for_submaps(1));
  EXPECT_EQ(rig.end(SIGKILL), -SIGKILL);
  const std::int64_t killed_ns = rig.last_sent_ns(0);
  const std::filesystem::path run = rig.runs()[0];
  const std::size_t finished = check_submaps(run);
  EXPECT_GE(finished, 1U);
  for (const char* const channel : {"CART_SCAN_H", "CART_SCAN_V"}) {
    const std::vector<LoggedScan> scans = scans_in(run / "raw-0000.lcmlog", channel);
    ASSERT_FALSE(scans.empty());
    EXPECT_EQ(scans.back().index - scans.front().index + 1, scans.size()) << "no gap in " << channel;
    EXPECT_LT(killed_ns - scans.back().mono_ns, 1'000'000'000) << channel;
  }
  // The cart stands at the start of its tour again, where the run's first sub-map was made: another place than the
  // last.
  rig.plug_scanners();
  rig.start();
  EXPECT_TRUE(rig.wait_for_health([&](const json& h) {
    return h["state"] == "mapping" && h["run"] == run.filename().string() && h["scanners"]["horizontal"]["scans"] > 40;
  }));
  EXPECT_EQ(save_map(rig, "after")["state"], "done");
  EXPECT_EQ(rig.ask({{"verb", "new-run"}})["state"], "done");
  EXPECT_TRUE(rig.wait_for_health(
      [&](const json& h) { return rig.runs().size() == 2 && h["run"] == rig.runs().back().filename().string(); }));
  EXPECT_EQ(rig.end(SIGTERM), 0);
  ASSERT_EQ(rig.runs().size(), 2U);
  EXPECT_EQ(DaemonRig::journal_of(rig.runs()[0]).cart, DaemonRig::journal_of(rig.runs()[1]).cart);
  EXPECT_GT(check_submaps(run), finished);
  const JournalContents journal = DaemonRig::journal_of(run);
  EXPECT_TRUE(std::holds_alternative<RunEnded>(journal.records.back().event));
  EXPECT_TRUE(std::any_of(journal.records.begin(), journal.records.end(), [](const JournalRecord& record) {
    return std::holds_alternative<RunContinued>(record.event);
  }));
  EXPECT_TRUE(std::filesystem::exists(run / "raw-0001.lcmlog"));
}

}  // namespace
}  // namespace submapd::test
