// Threads that map the chunks of a log, each with a mapper and a reader of its own; one caller takes them in order.
//
// Memory is that of one mapper for each thread; chunks that wait for the caller are on the disk. The chunks are the
// same for any number of threads.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <thread>
#include <vector>

#include "daemon/configuration.hpp"
#include "daemon/mutex.hpp"
#include "tools/replay/chunk_mapper.hpp"

namespace submapd::tools {

struct ChunkTeamOptions {
  std::string log;
  Configuration configuration;
  ChunkOptions chunks;
  int workers = 1;
  int threads = 1;               // of each one's particle filter
  std::filesystem::path folder;  // for what is on the disk meanwhile; exists
  Uuid cart;
  Uuid run;
};

// How far the threads are.
struct ChunkTeamProgress {
  std::uint64_t scans = 0;  // mapped, those of finished chunks
  double share = 0.0;       // of the log, of the reader that is least far
};

class ChunkTeam {
 public:
  explicit ChunkTeam(ChunkTeamOptions options);
  // Stops: waits for the scans that are just being mapped.
  ~ChunkTeam();
  ChunkTeam(const ChunkTeam&) = delete;
  ChunkTeam& operator=(const ChunkTeam&) = delete;

  // The next chunk in the order of the log, nothing at its end; waits for it and calls `tell` meanwhile. Errors: of the
  // chunk, or of a thread.
  Expected<std::optional<MappedChunk>> take(const std::function<void(const ChunkTeamProgress&)>& tell);
  [[nodiscard]] static std::filesystem::path folder_of(const std::filesystem::path& folder, std::uint64_t chunk);

  // Once take() gave nothing: what the mappers' pools held at most, all threads together, and what the readers met.
  [[nodiscard]] std::vector<ByteBudget> bytes() const;
  [[nodiscard]] LogSummary log() const;

 private:
  void work(std::size_t worker, const std::stop_token& stop);
  Status map_chunks(std::size_t worker, const std::stop_token& stop);
  // The next chunk nobody has begun, once the caller is near enough; nothing: the log is known to end before.
  [[nodiscard]] std::optional<std::uint64_t> claim(const std::stop_token& stop);
  void hand_over(std::size_t worker, std::uint64_t number, Expected<MappedChunk> chunk);

  const ChunkTeamOptions options_;
  mutable Mutex mutex_;
  std::condition_variable_any changed_;
  std::map<std::uint64_t, Expected<MappedChunk>> done_ GUARDED_BY(mutex_);
  std::uint64_t claimed_ GUARDED_BY(mutex_) = 0;
  std::uint64_t taken_ GUARDED_BY(mutex_) = 0;
  std::optional<std::uint64_t> chunks_ GUARDED_BY(mutex_);  // of the log, once its end was seen
  Status status_ GUARDED_BY(mutex_);
  std::uint64_t scans_ GUARDED_BY(mutex_) = 0;
  std::vector<std::vector<ByteBudget>> bytes_ GUARDED_BY(mutex_);  // by worker
  LogSummary log_ GUARDED_BY(mutex_);
  std::vector<std::atomic<double>> progress_;  // by worker
  std::vector<std::jthread> threads_;          // last: they end before what they use
};

}  // namespace submapd::tools
