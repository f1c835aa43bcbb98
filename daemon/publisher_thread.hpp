// The thread that sends over LCM: a pose for each mapped scan, finished sub-maps in paced chunks, and what others post.
//
// Never touches the disk, and nobody waits for it: what does not fit its queues is counted and left out; the optimizer
// reads a sub-map that was not sent from the archive. Without a multicast route it tries again now and then. Threads:
// made and ended by the daemon; post() and hand_over() by any, state() by any.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "daemon/heartbeat.hpp"
#include "daemon/mapper_thread.hpp"
#include "daemon/mutex.hpp"
#include "daemon/optimizer_thread.hpp"
#include "daemon/run_clock.hpp"
#include "daemon/submap_publisher.hpp"
#include "slam/base/sha256.hpp"

namespace submapd {

struct PublisherThreadOptions {
  std::string url;
  Channels channels;
  bool graphs = false;  // send the optimizer's graphs too, because it has no network of its own
};

struct PublisherState {
  bool lcm = false;  // there is a network to send to
  std::uint64_t poses = 0;
  std::uint64_t posted = 0;   // scans and health
  std::uint64_t chunks = 0;   // of sub-maps
  std::uint64_t dropped = 0;  // messages shed before sending
  std::int64_t last_chunk_seq = -1;
  double scan_ms_p99 = 0.0;  // last byte of a scan to its pose sent, newest 2400 scans
};

class PublisherThread {
 public:
  // Starts. References must outlive the object; `reports` rings `bell`;
  // `room` is rung when some were taken.
  PublisherThread(PublisherThreadOptions options, const Uuid& cart, const Uuid& run, RunClock clock,
                  ReportRing& reports, driver::Doorbell& bell, RoomBell& room, const OptimizerThread& optimizer);
  PublisherThread(const PublisherThread&) = delete;
  PublisherThread& operator=(const PublisherThread&) = delete;
  // Sends what is queued, then ends.
  ~PublisherThread();

  // An encoded message, sent soon.
  void post(const std::string& channel, std::vector<std::byte> message);
  // A finished sub-map that is in the archive under this hash.
  void hand_over(std::shared_ptr<const FinishedSubmap> submap, const Sha256& hash);

  [[nodiscard]] const Heartbeat& heartbeat() const { return heartbeat_; }
  [[nodiscard]] PublisherState state() const;

 private:
  struct Posted {
    std::string channel;
    std::vector<std::byte> message;
  };
  struct HandedOver {
    std::shared_ptr<const FinishedSubmap> submap;
    Sha256 hash{};
  };
  void run();
  void seek_network();
  void send_pose(const MappedScan& mapped);
  void send_queued();
  void send_graph();
  void send(const std::string& channel, const std::vector<std::byte>& message);
  void note_latency(std::int64_t arrived_ns);

  const PublisherThreadOptions options_;
  const Uuid cart_;
  const Uuid run_;
  const RunClock clock_;
  ReportRing& reports_;
  driver::Doorbell& bell_;
  RoomBell& room_;
  const OptimizerThread& optimizer_;

  // Of the thread alone.
  std::unique_ptr<lcm::LCM> lcm_;
  std::unique_ptr<SubmapPublisher> submaps_;
  std::int64_t next_try_ns_ = 0;
  std::int64_t patience_ns_ = 0;
  std::uint32_t sent_version_ = 0;  // of the graph
  std::int64_t newest_stamp_us_ = 0;
  std::map<std::uint32_t, Pose2> odom_from_submap_;  // of the sub-maps from the graph's newest on
  Pose2 map_from_odom_;
  std::vector<float> latencies_ms_;
  std::size_t next_latency_ = 0;

  mutable Mutex mutex_;
  std::deque<Posted> posted_ GUARDED_BY(mutex_);
  std::deque<HandedOver> handed_over_ GUARDED_BY(mutex_);
  std::atomic<bool> queued_{false};
  std::atomic<bool> stop_{false};

  Heartbeat heartbeat_;
  std::atomic<bool> good_{false};
  std::atomic<std::uint64_t> poses_{0};
  std::atomic<std::uint64_t> posted_count_{0};
  std::atomic<std::uint64_t> dropped_{0};
  std::atomic<std::int64_t> last_chunk_seq_{-1};
  std::atomic<double> p99_ms_{0.0};

  std::thread thread_;
};

}  // namespace submapd
