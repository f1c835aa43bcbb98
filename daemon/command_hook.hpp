// Tells a program of the operator's (a tone, a lamp) how saving went: [hook] command.
//
// Runs it without arguments, one at a time, in a process group of its own, with SUBMAPD_EVENT (save-started, map-saved,
// save-failed, save-refused), SUBMAPD_MAP (the map's folder, when saved) and SUBMAPD_MESSAGE in its environment and
// nothing on its standard input. What takes too long is killed with all its children. tell() never blocks; any thread.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <string>
#include <thread>

#include "daemon/configuration.hpp"
#include "daemon/mutex.hpp"

namespace submapd {

struct HookEvent {
  std::string event;
  std::string map;
  std::string message;
};

class CommandHook {
 public:
  explicit CommandHook(const HookConfiguration& configuration);
  CommandHook(const CommandHook&) = delete;
  CommandHook& operator=(const CommandHook&) = delete;
  // Kills what still runs; what waits is not told any more.
  ~CommandHook();

  void tell(HookEvent event);
  void configure(const HookConfiguration& configuration);
  [[nodiscard]] std::uint64_t failed() const;  // did not start, were killed, ended with an error, or waited in vain

 private:
  void run();
  // Empty if it ended well.
  [[nodiscard]] std::string run_one(const HookConfiguration& configuration, const HookEvent& event) const;

  const int stop_fd_;  // readable when the object goes
  mutable Mutex mutex_;
  std::condition_variable_any changed_;
  HookConfiguration configuration_ GUARDED_BY(mutex_);
  std::deque<HookEvent> events_ GUARDED_BY(mutex_);
  std::uint64_t failed_ GUARDED_BY(mutex_) = 0;
  bool stop_ GUARDED_BY(mutex_) = false;
  std::thread thread_;
};

}  // namespace submapd
