#include "daemon/optimizer_thread.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <exception>
#include <lcm/lcm-cpp.hpp>
#include <span>
#include <stdexcept>
#include <system_error>
#include <utility>
#include <vector>

#include "daemon/lcm_receive.hpp"
#include "proto/graph_conversion.hpp"
#include "slam/submap/submap_codec.hpp"

namespace submapd {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kNice = 10;             // below the mapper in everything
constexpr int kDrainMessages = 4096;  // at a time, so that a flood cannot keep the thread from what was announced
constexpr Clock::time_point kNever = Clock::time_point::max();

}  // namespace

class OptimizerThread::WakeUp {
 public:
  WakeUp() : fd_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
    if (fd_ < 0) throw std::system_error(errno, std::generic_category(), "eventfd");
  }
  WakeUp(const WakeUp&) = delete;
  WakeUp& operator=(const WakeUp&) = delete;
  ~WakeUp() { ::close(fd_); }

  // Neither fails but when the counter is full or empty, and then it does not matter.
  void set() { (void)::eventfd_write(fd_, 1); }
  void clear() {
    eventfd_t count = 0;
    (void)::eventfd_read(fd_, &count);
  }
  [[nodiscard]] int fd() const { return fd_; }

 private:
  int fd_;
};

OptimizerThread::OptimizerThread(OptimizerThreadOptions options, lcm::LCM& lcm, ChunkAssembler::KnownHash known_hash,
                                 SubmapSource& source, BackEnd& back_end)
    : options_(std::move(options)),
      lcm_(lcm),
      source_(source),
      back_end_(back_end),
      wake_up_(std::make_unique<WakeUp>()),
      assembler_(options_.cart, options_.run, std::move(known_hash), options_.chunk_bytes_limit) {
  receive_fd_ = can_receive(lcm_) ? lcm_.getFileno() : -1;
  if (receive_fd_ >= 0) {
    // Not subscribe() with a method: g++ 12's -fsanitize=vptr misjudges the method call in LCM's header.
    subscription_ = lcm_.subscribeFunction(options_.channels.submap, &OptimizerThread::on_chunk, this);
    subscription_->setQueueCapacity(options_.queue_capacity);
  }
  thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

OptimizerThread::~OptimizerThread() {
  thread_.request_stop();
  wake_up_->set();
  thread_.join();
  if (subscription_ != nullptr) lcm_.unsubscribe(subscription_);
}

void OptimizerThread::announce(std::uint32_t last_index) {
  {
    const MutexLock lock(mutex_);
    announced_ = std::max<std::int64_t>(announced_, last_index);
  }
  wake_up_->set();
}

Status OptimizerThread::wait_until_processed(std::uint32_t index) {
  announce(index);
  const MutexLock lock(mutex_);
  std::uint32_t seen = processed_;
  Clock::time_point deadline = Clock::now() + options_.no_progress_timeout;
  while (processed_ <= index && !ended_) {
    const bool timed_out = changed_.wait_until(mutex_, deadline) == std::cv_status::timeout;
    if (processed_ != seen) {
      seen = processed_;
      deadline = Clock::now() + options_.no_progress_timeout;
    } else if (timed_out && processed_ <= index && !ended_) {
      return Status(StatusCode::kUnavailable,
                    fmt::format("the optimizer has not moved for {} s; it waits for sub-map {}",
                                options_.no_progress_timeout.count(), processed_));
    }
  }
  if (processed_ > index) return {};
  return status_.ok() ? Status(StatusCode::kUnavailable, "the optimizer thread has been stopped") : status_;
}

Expected<FinalResult> OptimizerThread::finish() {
  {
    const MutexLock lock(mutex_);
    finish_wanted_ = true;
    final_result_.reset();
  }
  return wait_for_result();
}

Expected<FinalResult> OptimizerThread::finish_with(std::shared_ptr<const FinishedSubmap> open) {
  const std::uint32_t index = open->id.index;
  if (index > 0) {
    if (Status status = wait_until_processed(index - 1); !status.ok()) return failure(status);
  }
  {
    const MutexLock lock(mutex_);
    open_ = std::move(open);
    finish_wanted_ = true;
    final_result_.reset();
  }
  return wait_for_result();
}

Expected<FinalResult> OptimizerThread::wait_for_result() {
  wake_up_->set();
  const MutexLock lock(mutex_);
  while (!final_result_ && !ended_) changed_.wait(mutex_);
  if (final_result_) {
    Expected<FinalResult> result = std::move(*final_result_);
    final_result_.reset();
    return result;
  }
  return failure(status_.ok() ? Status(StatusCode::kUnavailable, "the optimizer thread has been stopped") : status_);
}

GraphState OptimizerThread::latest() const {
  const MutexLock lock(mutex_);
  return latest_;
}

std::uint32_t OptimizerThread::version() const {
  const MutexLock lock(mutex_);
  return latest_.version;
}

std::optional<SubmapPose> OptimizerThread::newest() const {
  const MutexLock lock(mutex_);
  if (latest_.submaps.empty()) return std::nullopt;
  return latest_.submaps.back();
}

OptimizerThreadCounters OptimizerThread::counters() const {
  const MutexLock lock(mutex_);
  return counters_;
}

OptimizerCounters OptimizerThread::back_end_counters() const {
  const MutexLock lock(mutex_);
  return back_end_counters_;
}

Status OptimizerThread::status() const {
  const MutexLock lock(mutex_);
  return status_;
}

void OptimizerThread::run(const std::stop_token& stop) {
  // A refusal leaves the priority as it is: slower for others, not wrong.
  (void)::setpriority(PRIO_PROCESS, static_cast<id_t>(::gettid()), kNice);
  Status status;
  try {
    status = loop(stop);
  } catch (const std::exception& error) {
    status = Status(StatusCode::kInternal, fmt::format("optimizer thread: {}", error.what()));
  }
  const MutexLock lock(mutex_);
  status_ = std::move(status);
  ended_ = true;
  changed_.notify_all();
}

Status OptimizerThread::loop(const std::stop_token& stop) {
  std::uint32_t waiting_for = 0;  // the sub-map that is announced and not there, and when it counts as lost
  Clock::time_point lost_at = kNever;
  while (!stop.stop_requested()) {
    int timeout_ms = -1;
    if (lost_at != kNever) {
      const auto left = std::chrono::ceil<std::chrono::milliseconds>(lost_at - Clock::now());
      timeout_ms = std::max(0, static_cast<int>(left.count()));
    }
    // poll() ignores negative descriptors: without LCM it waits for announcements alone.
    std::array<pollfd, 2> fds{{{wake_up_->fd(), POLLIN, 0}, {receive_fd_, POLLIN, 0}}};
    if (::poll(fds.data(), fds.size(), timeout_ms) < 0 && errno != EINTR) {
      return Status(StatusCode::kIo, fmt::format("optimizer thread: poll: {}", std::generic_category().message(errno)));
    }
    wake_up_->clear();

    // What is announced now has been sent before: on memq:// it is in the queue that drain() empties.
    std::int64_t announced = -1;
    bool finish_wanted = false;
    {
      const MutexLock lock(mutex_);
      announced = announced_;
      finish_wanted = finish_wanted_;
    }
    if (Status status = drain(stop); !status.ok()) return status;

    if (announced < static_cast<std::int64_t>(next_)) {
      lost_at = kNever;
    } else if (lost_at == kNever || waiting_for != next_) {
      waiting_for = next_;
      lost_at = Clock::now() + options_.lost_after;
    }
    if (lost_at != kNever && (finish_wanted || Clock::now() >= lost_at)) {
      if (Status status = read_lost(static_cast<std::uint32_t>(announced) + 1, stop); !status.ok()) return status;
      lost_at = kNever;
    }
    if (finish_wanted && !stop.stop_requested()) answer_finish();
  }
  return {};
}

Status OptimizerThread::drain(const std::stop_token& stop) {
  if (receive_fd_ < 0) return {};
  for (int messages = 0; messages < kDrainMessages && !stop.stop_requested(); ++messages) {
    const int handled = lcm_.handleTimeout(0);
    if (handled < 0) return Status(StatusCode::kIo, "optimizer thread: LCM cannot receive");
    if (handled == 0) break;
    {
      const MutexLock lock(mutex_);
      counters_.chunks = assembler_.counters();
    }
    if (!complete_) continue;
    const ChunkAssembler::Complete complete = std::move(*complete_);
    complete_.reset();
    if (Status status = read_lost(complete.index, stop); !status.ok()) return status;
    if (stop.stop_requested()) break;
    if (Status status = take_complete(complete); !status.ok()) return status;
  }
  return {};
}

Status OptimizerThread::take_complete(const ChunkAssembler::Complete& complete) {
  Expected<FinishedSubmap> submap = decode_submap(complete.raw);
  if (!submap) return submap.error();
  if (submap->id != SubmapId{options_.cart, options_.run, complete.index}) {
    return Status(StatusCode::kCorrupt, fmt::format("the sub-map sent as {} holds another id", complete.index));
  }
  return feed(std::make_shared<const FinishedSubmap>(std::move(*submap)));
}

Status OptimizerThread::read_lost(std::uint32_t end, const std::stop_token& stop) {
  while (next_ < end && !stop.stop_requested()) {
    {
      const MutexLock lock(mutex_);
      ++counters_.lost;
    }
    if (options_.lost_is_error) {
      return Status(StatusCode::kInternal, fmt::format("sub-map {} was lost on its way over LCM", next_));
    }
    Expected<std::shared_ptr<const FinishedSubmap>> submap = source_.load(next_);
    if (!submap) return submap.error();
    if ((*submap)->id != SubmapId{options_.cart, options_.run, next_}) {
      return Status(StatusCode::kCorrupt, fmt::format("the archive's sub-map {} is of another run", next_));
    }
    {
      const MutexLock lock(mutex_);
      ++counters_.reread;
    }
    if (Status status = feed(*submap); !status.ok()) return status;
  }
  return {};
}

Status OptimizerThread::feed(const std::shared_ptr<const FinishedSubmap>& submap) {
  Expected<GraphState> state = back_end_.add_submap(submap);
  if (!state) return state.error();
  assembler_.forget_below(++next_);
  publish_graph(*state, *submap);
  const OptimizerCounters back_end_counters = back_end_.counters();

  const MutexLock lock(mutex_);
  latest_ = std::move(*state);
  back_end_counters_ = back_end_counters;
  counters_.chunks = assembler_.counters();
  ++counters_.submaps;
  processed_ = next_;
  changed_.notify_all();
  return {};
}

void OptimizerThread::publish_graph(const GraphState& state, const FinishedSubmap& newest) {
  if (!lcm_.good()) return;
  const std::int64_t utime = newest.keyframes.empty() ? 0 : newest.keyframes.back().stamp_us;
  bool sent = true;
  bool first = true;
  for (const std::vector<std::byte>& part : encode_graph(state, utime, options_.cart, options_.run)) {
    if (!std::exchange(first, false) && options_.graph_pace.count() > 0)
      std::this_thread::sleep_for(options_.graph_pace);
    if (lcm_.publish(options_.channels.graph, part.data(), static_cast<unsigned>(part.size())) != 0) sent = false;
  }
  const MutexLock lock(mutex_);
  ++(sent ? counters_.graphs_published : counters_.publish_errors);
}

void OptimizerThread::on_chunk(const lcm::ReceiveBuffer* buffer, const std::string& /*channel*/,
                               OptimizerThread* self) {
  self->complete_ = self->assembler_.add(bytes_of(buffer));
}

void OptimizerThread::answer_finish() {
  std::shared_ptr<const FinishedSubmap> open;
  {
    const MutexLock lock(mutex_);
    open = std::exchange(open_, nullptr);
  }
  Expected<FinalResult> result = open ? back_end_.finish_with(open) : back_end_.finish();
  const MutexLock lock(mutex_);
  finish_wanted_ = false;
  back_end_counters_ = back_end_.counters();
  final_result_ = std::move(result);
  changed_.notify_all();
}

}  // namespace submapd
