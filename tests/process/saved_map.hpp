// Saves maps with the daemon of a DaemonRig, and judges them by where the cart really was.
#pragma once

#include "slam/output/trajectory_file.hpp"
#include "tests/process/daemon_rig.hpp"

namespace submapd::test {

// The last reply.
[[nodiscard]] inline json save_map(DaemonRig& rig, json request) {
  request["verb"] = "save-map";
  request["wait"] = true;
  Expected<tools::ControlClient> client = tools::ControlClient::connect(rig.socket());
  if (!client) return json::object();
  Expected<json> reply = client->ask(request);
  while (reply && tools::text_of(*reply, "state") == "working") reply = client->receive(std::chrono::seconds(30));
  return reply ? *reply : json::object();
}

[[nodiscard]] inline std::string text_in(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

// Of the saved map `hall`, laid on its first pose.
[[nodiscard]] inline Pose2 world_from_map(const DaemonRig& rig, const std::filesystem::path& run) {
  const JournalContents journal = DaemonRig::journal_of(run);
  const RunClock clock(std::get<RunStarted>(journal.records.front().event).wall_minus_mono_ns);
  const auto poses = read_tum(run / "maps" / "hall" / "trajectory.tum");
  EXPECT_TRUE(poses.has_value() && !poses->empty());
  if (!poses || poses->empty()) return {};
  const StampedPose& first = poses->front();
  return compose(rig.truth(first.stamp_us * 1000 - clock.offset_ns()), inverse(first.pose));
}

// Saves `hall` of a run that lost nothing, and compares its trajectory with the truth.
inline void expect_good_map(DaemonRig& rig) {
  const json health = rig.health();
  EXPECT_EQ(health["mapper"]["missing"], 0);
  EXPECT_EQ(health["mapper"]["skipped"], 0);
  EXPECT_EQ(health["recorder"]["raw_lost"], 0);
  ASSERT_EQ(save_map(rig, {{"name", "hall"}})["state"], "done");
  const std::filesystem::path run = rig.runs()[0];
  const Pose2 to_world = world_from_map(rig, run);
  const RunClock clock(std::get<RunStarted>(DaemonRig::journal_of(run).records.front().event).wall_minus_mono_ns);
  double worst = 0.0;
  const Expected<std::vector<StampedPose>> poses = read_tum(run / "maps" / "hall" / "trajectory.tum");
  ASSERT_TRUE(poses.has_value());
  for (const StampedPose& p : *poses) {
    const Pose2 truth = rig.truth(p.stamp_us * 1000 - clock.offset_ns());
    worst = std::max(worst, (compose(to_world, p.pose).translation() - truth.translation()).norm());
  }
  EXPECT_LT(worst, 0.05) << "the map is bent";
}

}  // namespace submapd::test
