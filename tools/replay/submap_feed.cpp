#include "tools/replay/submap_feed.hpp"

#include <utility>

#include "daemon/version.hpp"
#include "slam/base/atomic_file.hpp"
#include "slam/submap/submap_codec.hpp"

namespace submapd::tools {
namespace {

OptimizerOptions optimizer_options(const Configuration& configuration, bool loops) {
  OptimizerOptions o;
  o.loops = loops;
  o.parts = configuration.graph_parts;
  o.graph_bytes_limit = configuration.graph_bytes;
  return o;
}

OptimizerThreadOptions thread_options(const Uuid& cart, const Uuid& run) {
  OptimizerThreadOptions o;
  o.cart = cart;
  o.run = run;
  o.queue_capacity = 1024;
  o.chunk_bytes_limit = kMaxEncodedSubmapBytes;  // one of any size comes through
  o.lost_after = std::chrono::milliseconds(0);
  o.lost_is_error = true;
  o.graph_pace = std::chrono::microseconds(0);
  return o;
}

}  // namespace

SubmapFeed::SubmapFeed(const Configuration& configuration, bool loops, const Uuid& cart, const Uuid& run,
                       std::unique_ptr<SubmapArchive> archive)
    : graph_bytes_limit_(configuration.graph_bytes),
      archive_(std::move(archive)),
      lcm_("memq://"),
      publisher_(lcm_, SubmapPublisherOptions{Channels(), std::chrono::microseconds(0)}),
      optimizer_(optimizer_options(configuration, loops), *archive_),
      thread_(
          thread_options(cart, run), lcm_,
          [this](std::uint32_t index, const Sha256& hash) { return journal_.find(index) == hash; }, *archive_,
          optimizer_),
      cart_(cart),
      run_(run) {}

Status SubmapFeed::feed(const FinishedSubmap& finished) {
  const Expected<Sha256> hash = archive_->save(finished);
  if (!hash) return hash.error();
  journal_.add(finished.id.index, *hash);
  if (records_.empty()) records_.push_back({finished.keyframes.front().stamp_us, RunStarted{0, kVersion}});
  records_.push_back({finished.keyframes.back().stamp_us, SubmapSaved{finished.id.index, *hash}});
  if (Status status = publisher_.publish(finished, *hash); !status.ok()) return status;
  if (Status status = thread_.wait_until_processed(finished.id.index); !status.ok()) return status;
  ++fed_;
  // The newest optimised sub-map carries the odom frame into the map.
  if (const std::optional<SubmapPose> newest = thread_.newest()) {
    map_from_odom_ = compose(newest->map_from_submap, inverse(finished.odom_from_submap));
  }
  return {};
}

Status SubmapFeed::write_journal(const std::filesystem::path& path) const {
  std::vector<JournalRecord> records = records_;
  if (!records.empty()) records.push_back({records.back().utime_us, RunEnded{}});
  return atomic_write_file(path, encode_journal(cart_, run_, records));
}

Expected<FinalResult> SubmapFeed::finish(ReplayMetrics& metrics) {
  Expected<FinalResult> result = thread_.finish();
  metrics.optimizer = optimizer_.counters();
  const BytesUse cache = archive_->cache_bytes();
  metrics.bytes.push_back({"submap_cache", cache.used, cache.peak, cache.limit});
  metrics.bytes.push_back({"graph", metrics.optimizer.bytes_used, metrics.optimizer.bytes_peak, graph_bytes_limit_});
  return result;
}

}  // namespace submapd::tools
