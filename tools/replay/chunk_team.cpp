#include "tools/replay/chunk_team.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <exception>
#include <utility>

#include "daemon/thread_pool.hpp"
#include "tools/replay/recording.hpp"

namespace submapd::tools {
namespace {

constexpr std::uint64_t kWaitingChunks = 4;  // for each thread; more only fill the disk
constexpr std::chrono::milliseconds kTell{200};

}  // namespace

ChunkTeam::ChunkTeam(ChunkTeamOptions options)
    : options_(std::move(options)),
      bytes_(static_cast<std::size_t>(options_.workers)),
      progress_(static_cast<std::size_t>(options_.workers)) {
  for (std::size_t worker = 0; worker < progress_.size(); ++worker) {
    threads_.emplace_back([this, worker](const std::stop_token& stop) { work(worker, stop); });
  }
}

ChunkTeam::~ChunkTeam() {
  for (std::jthread& thread : threads_) thread.request_stop();
  {
    const MutexLock lock(mutex_);
    changed_.notify_all();
  }
  threads_.clear();
}

std::filesystem::path ChunkTeam::folder_of(const std::filesystem::path& folder, std::uint64_t chunk) {
  return folder / fmt::format("{:06}", chunk);
}

void ChunkTeam::work(std::size_t worker, const std::stop_token& stop) {
  Status status;
  try {
    status = map_chunks(worker, stop);
  } catch (const std::exception& error) {  // no memory, no threads
    status = Status(StatusCode::kInternal, fmt::format("worker {}: {}", worker, error.what()));
  }
  const MutexLock lock(mutex_);
  if (!status.ok() && status_.ok()) status_ = std::move(status);
  changed_.notify_all();
}

Status ChunkTeam::map_chunks(std::size_t worker, const std::stop_token& stop) {
  Expected<Recording> recording = open_recording(options_.log, options_.configuration.lcm.prefix);
  if (!recording) return recording.error();
  ChunkReader reader(std::move(recording->reader), options_.chunks);
  ThreadPool pool(options_.threads);
  while (const std::optional<std::uint64_t> number = claim(stop)) {
    const Expected<bool> there = reader.enter(*number);
    if (!there) return there.error();
    if (!*there) {
      const MutexLock lock(mutex_);
      chunks_ = std::min(chunks_.value_or(*number), *number);
      log_ = reader.log().summary();
      changed_.notify_all();
      break;
    }
    const auto go_on = [&] {
      progress_[worker].store(reader.log().progress(), std::memory_order_relaxed);
      return !stop.stop_requested();
    };
    hand_over(worker, *number,
              map_chunk(reader, options_.configuration.mapper, options_.cart, options_.run, pool,
                        {folder_of(options_.folder, *number), options_.folder}, go_on));
  }
  progress_[worker].store(1.0);
  return {};
}

std::optional<std::uint64_t> ChunkTeam::claim(const std::stop_token& stop) {
  const MutexLock lock(mutex_);
  const std::uint64_t most = kWaitingChunks * progress_.size();
  while (!stop.stop_requested() && status_.ok() && claimed_ >= taken_ + most) changed_.wait(mutex_);
  if (stop.stop_requested() || !status_.ok() || (chunks_ && claimed_ >= *chunks_)) return std::nullopt;
  return claimed_++;
}

void ChunkTeam::hand_over(std::size_t worker, std::uint64_t number, Expected<MappedChunk> chunk) {
  const MutexLock lock(mutex_);
  if (chunk) {
    scans_ += chunk->scans.scans;
    std::vector<ByteBudget>& most = bytes_[worker];
    most.resize(std::max(most.size(), chunk->bytes.size()));
    for (std::size_t k = 0; k < chunk->bytes.size(); ++k) {
      const std::size_t peak = std::max(most[k].peak, chunk->bytes[k].peak);
      most[k] = chunk->bytes[k];
      most[k].peak = peak;
    }
  }
  done_.emplace(number, std::move(chunk));
  changed_.notify_all();
}

Expected<std::optional<MappedChunk>> ChunkTeam::take(const std::function<void(const ChunkTeamProgress&)>& tell) {
  MutexLock lock(mutex_);
  for (;;) {
    if (const auto found = done_.find(taken_); found != done_.end()) {
      Expected<MappedChunk> chunk = std::move(found->second);
      done_.erase(found);
      ++taken_;
      changed_.notify_all();
      if (!chunk) return failure(chunk.error());
      return std::optional<MappedChunk>(std::move(*chunk));
    }
    if (!status_.ok()) return failure(status_);
    if (chunks_ && taken_ >= *chunks_) return std::optional<MappedChunk>();
    changed_.wait_for(mutex_, kTell);
    ChunkTeamProgress progress{scans_, 1.0};
    for (const std::atomic<double>& share : progress_) progress.share = std::min(progress.share, share.load());
    tell(progress);
  }
}

std::vector<ByteBudget> ChunkTeam::bytes() const {
  const MutexLock lock(mutex_);
  std::vector<ByteBudget> sum;
  for (const std::vector<ByteBudget>& one : bytes_) {
    sum.resize(std::max(sum.size(), one.size()));
    for (std::size_t k = 0; k < one.size(); ++k) {
      sum[k].name = one[k].name;
      sum[k].used += one[k].used;
      sum[k].peak += one[k].peak;
      sum[k].limit += one[k].limit;
    }
  }
  return sum;
}

LogSummary ChunkTeam::log() const {
  const MutexLock lock(mutex_);
  return log_;
}

}  // namespace submapd::tools
