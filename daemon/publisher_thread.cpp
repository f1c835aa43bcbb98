#include "daemon/publisher_thread.hpp"

#include <algorithm>
#include <lcm/lcm-cpp.hpp>
#include <utility>

#include "daemon/daemon_log.hpp"
#include "daemon/multicast_route.hpp"
#include "daemon/realtime.hpp"
#include "driver/monotonic.hpp"
#include "proto/graph_conversion.hpp"
#include "proto/lcm_message.hpp"
#include "submapd/pose_t.hpp"

namespace submapd {
namespace {

constexpr std::chrono::milliseconds kIdle{100};
constexpr std::int64_t kFirstPatience_ns = 2 * kSecond_ns;  // before another try for a network, doubling
constexpr std::int64_t kLongestPatience_ns = 60 * kSecond_ns;
constexpr std::chrono::milliseconds kGraphPace{2};  // between its parts
constexpr std::size_t kMostPosted = 64;
constexpr std::size_t kMostHandedOver = 4;
constexpr std::size_t kLatencies = 2400;  // a minute
constexpr std::size_t kLatencyStep = 40;  // a second between two looks at the percentile

}  // namespace

PublisherThread::PublisherThread(PublisherThreadOptions options, const Uuid& cart, const Uuid& run, RunClock clock,
                                 ReportRing& reports, driver::Doorbell& bell, RoomBell& room,
                                 const OptimizerThread& optimizer)
    : options_(std::move(options)),
      cart_(cart),
      run_(run),
      clock_(std::move(clock)),
      reports_(reports),
      bell_(bell),
      room_(room),
      optimizer_(optimizer),
      patience_ns_(kFirstPatience_ns) {
  latencies_ms_.reserve(kLatencies);
  thread_ = std::thread([this] { this->run(); });
}

PublisherThread::~PublisherThread() {
  stop_.store(true);
  bell_.ring();
  thread_.join();
}

void PublisherThread::post(const std::string& channel, std::vector<std::byte> message) {
  {
    const MutexLock lock(mutex_);
    if (posted_.size() >= kMostPosted) {
      dropped_.fetch_add(1, std::memory_order_relaxed);
      return;
    }
    posted_.push_back({channel, std::move(message)});
  }
  queued_.store(true);
  bell_.ring();
}

void PublisherThread::hand_over(std::shared_ptr<const FinishedSubmap> submap, const Sha256& hash) {
  {
    const MutexLock lock(mutex_);
    handed_over_.push_back({std::move(submap), hash});
    if (handed_over_.size() > kMostHandedOver) {
      handed_over_.pop_front();
      dropped_.fetch_add(1, std::memory_order_relaxed);
    }
  }
  queued_.store(true);
  bell_.ring();
}

PublisherState PublisherThread::state() const {
  const std::int64_t last_chunk = last_chunk_seq_.load();
  return {good_.load(),    poses_.load(), posted_count_.load(), static_cast<std::uint64_t>(last_chunk + 1),
          dropped_.load(), last_chunk,    p99_ms_.load()};
}

void PublisherThread::run() {
  name_thread("publisher");
  const auto something = [this] { return reports_.has_data() || queued_.load() || stop_.load(); };
  for (;;) {
    bell_.wait(something, kIdle);
    heartbeat_.beat();
    const bool stop = stop_.load();
    if (!stop) seek_network();
    while (const MappedScan* const mapped = reports_.front()) {
      send_pose(*mapped);
      note_latency(mapped->arrived_ns);
      reports_.pop();
    }
    room_.ring();
    send_queued();
    if (options_.graphs) send_graph();
    if (stop) return;
  }
}

void PublisherThread::seek_network() {
  if (good_.load(std::memory_order_relaxed) || driver::monotonic_now_ns() < next_try_ns_) return;
  if (has_multicast_route(options_.url)) lcm_ = std::make_unique<lcm::LCM>(options_.url);
  if (lcm_ != nullptr && lcm_->good()) {
    SubmapPublisherOptions paced;
    paced.channels = options_.channels;
    submaps_ = std::make_unique<SubmapPublisher>(*lcm_, paced);
    good_.store(true);
    log(Severity::kInfo, "publishing on " + options_.url);
    return;
  }
  lcm_.reset();
  if (patience_ns_ == kFirstPatience_ns) {
    log(Severity::kWarning,
        "no network for LCM at " + options_.url + ": mapping goes on; a route helps: ip route add 224.0.0.0/4 dev lo");
  }
  next_try_ns_ = driver::monotonic_now_ns() + patience_ns_;
  patience_ns_ = std::min(2 * patience_ns_, kLongestPatience_ns);
}

void PublisherThread::send(const std::string& channel, const std::vector<std::byte>& message) {
  if (lcm_ != nullptr && lcm_->publish(channel, message.data(), static_cast<unsigned>(message.size())) == 0) return;
  dropped_.fetch_add(1, std::memory_order_relaxed);
}

void PublisherThread::send_pose(const MappedScan& mapped) {
  // The newest optimised sub-map carries the odom frame into the map.
  if (const std::optional<SubmapPose> newest = optimizer_.newest()) {
    const auto known = odom_from_submap_.find(newest->index);
    if (known != odom_from_submap_.end()) {
      map_from_odom_ = compose(newest->map_from_submap, inverse(known->second));
      odom_from_submap_.erase(odom_from_submap_.begin(), known);
    }
  }
  const ScanReport& report = mapped.report;
  pose_t pose{};
  pose.utime = report.stamp_us;
  pose.seq = static_cast<std::int64_t>(report.scan_index);
  put_uuid(cart_, pose.cart);
  put_uuid(run_, pose.run);
  put_pose(compose(map_from_odom_, report.odom_from_base), pose.map_from_base);
  pose.submap = static_cast<std::int32_t>(report.submap);
  put_pose(report.submap_from_base, pose.submap_from_base);
  for (int i = 0; i < 9; ++i) pose.covariance[i] = report.covariance(i / 3, i % 3);
  pose.entropy = report.entropy;
  pose.particles = report.particles;
  pose.n_eff = report.n_eff;
  pose.degenerate = report.degenerate ? 1 : 0;
  send(options_.channels.pose, encode_message(pose));
  poses_.fetch_add(1, std::memory_order_relaxed);
}

void PublisherThread::note_latency(std::int64_t arrived_ns) {
  const auto took_ms = static_cast<float>(static_cast<double>(clock_.now_ns() - arrived_ns) * 1e-6);
  if (latencies_ms_.size() < kLatencies) {
    latencies_ms_.push_back(took_ms);
  } else {
    latencies_ms_[next_latency_] = took_ms;
  }
  next_latency_ = (next_latency_ + 1) % kLatencies;
  if (next_latency_ % kLatencyStep != 0) return;
  std::vector<float> sorted = latencies_ms_;
  const auto at = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() * 99 / 100);
  std::nth_element(sorted.begin(), at, sorted.end());
  p99_ms_.store(static_cast<double>(*at));
}

void PublisherThread::send_graph() {
  if (lcm_ == nullptr || optimizer_.version() == sent_version_) return;
  const GraphState state = optimizer_.latest();
  sent_version_ = state.version;
  for (const std::vector<std::byte>& part : encode_graph(state, newest_stamp_us_, cart_, run_)) {
    send(options_.channels.graph, part);
    std::this_thread::sleep_for(kGraphPace);
  }
}

void PublisherThread::send_queued() {
  if (!queued_.exchange(false)) return;
  std::deque<Posted> posted;
  std::deque<HandedOver> handed_over;
  {
    const MutexLock lock(mutex_);
    posted.swap(posted_);
    handed_over.swap(handed_over_);
  }
  for (const Posted& p : posted) send(p.channel, p.message);
  posted_count_.fetch_add(posted.size(), std::memory_order_relaxed);
  for (const HandedOver& h : handed_over) {
    newest_stamp_us_ = h.submap->keyframes.back().stamp_us;
    odom_from_submap_[h.submap->id.index] = h.submap->odom_from_submap;
    if (submaps_ == nullptr) continue;
    // A failure is noticed by the optimizer, which reads the archive.
    if (!submaps_->publish(*h.submap, h.hash).ok()) dropped_.fetch_add(1, std::memory_order_relaxed);
    last_chunk_seq_.store(submaps_->messages() - 1);
  }
}

}  // namespace submapd
