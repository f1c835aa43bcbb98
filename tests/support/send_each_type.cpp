// Sends a message of each type on its channel, several times a second, until it is killed. Prints "CHANNEL TYPE UTIME"
// of each first.
#include <chrono>
#include <cstdio>
#include <functional>
#include <lcm/lcm-cpp.hpp>
#include <thread>
#include <vector>

#include "proto/channels.hpp"
#include "submapd/command_t.hpp"
#include "submapd/graph_t.hpp"
#include "submapd/health_t.hpp"
#include "submapd/intensities_t.hpp"
#include "submapd/odometry_t.hpp"
#include "submapd/pose_t.hpp"
#include "submapd/reply_t.hpp"
#include "submapd/scan_t.hpp"
#include "submapd/submap_chunk_t.hpp"
#include "submapd/trigger_t.hpp"

namespace {

using namespace submapd;

std::vector<std::function<void(lcm::LCM&)>> senders;

template <typename T>
void add(const std::string& channel, T message) {
  message.utime = 1000 + static_cast<std::int64_t>(senders.size());
  std::printf("%s %s %lld\n", channel.c_str(), T::getTypeName(), static_cast<long long>(message.utime));
  senders.emplace_back([channel, message](lcm::LCM& lcm) { (void)lcm.publish(channel, &message); });
}

}  // namespace

int main() {
  const Channels channels;
  scan_t scan{};
  scan.nranges = 1081;
  scan.range_mm.assign(1081, -1);
  add(channels.scan_h, scan);
  add(channels.scan_v, scan);
  intensities_t intensities{};
  intensities.nvalues = 1081;
  intensities.value.assign(1081, 7);
  add(channels.intensity_h, intensities);
  add(channels.intensity_v, intensities);
  add(channels.pose, pose_t{});
  submap_chunk_t chunk{};
  chunk.nbytes = 60'000;
  chunk.data.assign(60'000, 0xED);
  add(channels.submap, chunk);
  graph_t graph{};
  graph.nsubmaps = 2;
  graph.submaps.resize(2);
  graph.nloops = 3;
  graph.loops.resize(3);
  add(channels.graph, graph);
  health_t health{};
  health.message = "all is well";
  add(channels.health, health);
  add(channels.odometry, odometry_t{});
  add(channels.trigger, trigger_t{});
  add(channels.command, command_t{});
  add(channels.reply, reply_t{});
  std::fflush(stdout);
  lcm::LCM lcm("udpm://239.255.76.67:7667?ttl=0");
  for (;;) {
    for (const auto& send : senders) send(lcm);
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
}
