#include "daemon/lcm_requests.hpp"

#include <sys/eventfd.h>
#include <unistd.h>

#include <fmt/format.h>

#include <array>
#include <cerrno>
#include <lcm/lcm-cpp.hpp>
#include <span>
#include <system_error>
#include <utility>

#include "daemon/lcm_receive.hpp"
#include "daemon/map_folder.hpp"
#include "proto/channels.hpp"
#include "proto/lcm_message.hpp"
#include "submapd/command_t.hpp"
#include "submapd/reply_t.hpp"
#include "submapd/trigger_t.hpp"

namespace submapd {
namespace {

constexpr std::size_t kMostWaiting = 64;
constexpr int kQueue = 64;  // messages that LCM keeps of a channel

}  // namespace

std::string LcmCommand::id() const {
  return utime_us == 0 ? "" : fmt::format("lcm-{}", utime_us);
}

std::vector<std::byte> encode_command_reply(const LcmCommand& command, const ControlReply& reply, const Uuid& cart,
                                            const Uuid& run, std::int64_t utime_us) {
  constexpr std::array<std::int8_t, 3> kStates = {reply_t::DONE, reply_t::WORKING, reply_t::FAILED};
  constexpr std::array<std::int8_t, 3> kReasons = {reply_t::INPUT, reply_t::LATER, reply_t::OTHER};
  reply_t message{};
  message.utime = utime_us;
  put_uuid(cart, message.cart);
  put_uuid(run, message.run);
  message.command_utime = command.utime_us;
  message.command = command.command;
  message.state = kStates[static_cast<std::size_t>(reply.state)];
  message.reason =
      reply.state == ReplyState::kFailed ? kReasons[static_cast<std::size_t>(reason_of(reply))] : reply_t::NONE;
  message.progress = static_cast<std::int8_t>(reply.extra.value("progress", 0));
  message.message = reply.message;
  return encode_message(message);
}

LcmRequests::LcmRequests(const LcmConfiguration& configuration)
    : configuration_(configuration), fd_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  if (fd_ < 0) throw std::system_error(errno, std::generic_category(), "eventfd");
  listener_.emplace(configuration.url, "inputs", [this](lcm::LCM& network) { subscribe(network); });
}

LcmRequests::~LcmRequests() {
  listener_.reset();
  ::close(fd_);
}

std::optional<LcmRequest> LcmRequests::take() {
  const MutexLock lock(mutex_);
  if (requests_.empty()) {
    eventfd_t count = 0;
    (void)::eventfd_read(fd_, &count);
    return std::nullopt;
  }
  LcmRequest request = std::move(requests_.front());
  requests_.pop_front();
  return request;
}

LcmInputCounters LcmRequests::counters() const {
  return {taken_.load(), bad_.load(), dropped_.load()};
}

Expected<LcmRequest> LcmRequests::decode_trigger(std::span<const std::byte> bytes) {
  Expected<trigger_t> message = decode_with_text<trigger_t>(bytes);
  if (!message) return failure(message.error());
  ControlRequest request;
  request.verb = ControlVerb::kMark;
  request.name = std::move(message->name);
  if (!is_name(request.name)) return failure(StatusCode::kInvalidArgument, "trigger_t: no name");
  if (message->utime < 0) return failure(StatusCode::kInvalidArgument, "trigger_t: before 1970");
  if (message->utime > 0) request.utime_us = message->utime;
  return LcmRequest{std::move(request), std::nullopt, {}};
}

Expected<LcmRequest> LcmRequests::decode_command(std::span<const std::byte> bytes) {
  Expected<command_t> message = decode_with_text<command_t>(bytes);
  if (!message) return failure(message.error());
  const LcmCommand command{message->utime, message->command};
  ControlRequest request;
  request.id = command.id();
  const auto refused = [&](const char* why) {
    return LcmRequest{std::move(request), command, {StatusCode::kInvalidArgument, why}};
  };
  switch (message->command) {
    case command_t::SAVE_MAP:
      request.verb = ControlVerb::kSaveMap;
      break;
    case command_t::PAUSE:
      request.verb = ControlVerb::kPause;
      break;
    case command_t::RESUME:
      request.verb = ControlVerb::kResume;
      break;
    case command_t::MARK:
      request.verb = ControlVerb::kMark;
      break;
    default:
      return refused("unknown command; known are those of command_t");
  }
  const bool may_go_without = request.verb != ControlVerb::kMark;
  if (!is_name(message->name) && !(may_go_without && message->name.empty())) return refused(kNameRule);
  request.name = std::move(message->name);
  return LcmRequest{std::move(request), command, {}};
}

void LcmRequests::on_message(Expected<LcmRequest> request) {
  if (!request || !request->status.ok()) bad_.fetch_add(1, std::memory_order_relaxed);
  if (!request) return;
  const MutexLock lock(mutex_);
  if (requests_.size() >= kMostWaiting) {
    dropped_.fetch_add(1, std::memory_order_relaxed);
    return;
  }
  if (request->status.ok()) taken_.fetch_add(1, std::memory_order_relaxed);
  requests_.push_back(std::move(*request));
  (void)::eventfd_write(fd_, 1);
}

void LcmRequests::subscribe(lcm::LCM& network) {
  const Channels channels(configuration_.prefix);
  const auto listen = [&](const std::string& channel, auto on_bytes) {
    network.subscribeFunction(channel, +on_bytes, this)->setQueueCapacity(kQueue);
  };
  using Buffer = const lcm::ReceiveBuffer*;
  if (configuration_.triggers) {
    listen(channels.trigger, [](Buffer buffer, const std::string&, LcmRequests* self) {
      self->on_message(decode_trigger(bytes_of(buffer)));
    });
  }
  if (configuration_.commands) {
    listen(channels.command, [](Buffer buffer, const std::string&, LcmRequests* self) {
      self->on_message(decode_command(bytes_of(buffer)));
    });
  }
}

}  // namespace submapd
