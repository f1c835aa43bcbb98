// What submapctl and submapd say to each other (control-protocol.md): one JSON object a packet.
//
// Pure functions; any thread.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>

#include "slam/base/status.hpp"

namespace submapd {

inline constexpr std::size_t kMaxRequestBytes = 4096;
inline constexpr std::size_t kMaxReplyBytes = 65'536;

enum class ControlVerb { kStatus, kHealth, kSaveMap, kGetMap, kMark, kPause, kResume, kNewRun };

struct ControlRequest {
  ControlVerb verb = ControlVerb::kStatus;
  std::string id;    // at most 64 characters; comes back in the reply
  std::string name;  // of a map or a mark
  bool wait = false;
  bool force = false;
  bool cloud = false;
  std::optional<std::int64_t> utime_us;
};

[[nodiscard]] const char* verb_name(ControlVerb verb);

// Errors: kInvalidArgument, in words for who asked.
[[nodiscard]] Expected<ControlRequest> parse_request(std::string_view packet);

enum class ReplyState { kDone, kWorking, kFailed };

struct ControlReply {
  std::string id;  // the request's
  ReplyState state = ReplyState::kDone;
  std::string message;
  StatusCode code = StatusCode::kOk;                // with kFailed: makes the asker's exit code
  nlohmann::json extra = nlohmann::json::object();  // what else there is to tell
};
[[nodiscard]] ControlReply refusal(const std::string& id, const Status& status);

// Why it failed: the asker's fault, to be tried again later, or anything else.
enum class Refusal : std::uint8_t { kInput, kLater, kOther };
// REQUIRES: kFailed.
[[nodiscard]] Refusal reason_of(const ControlReply& reply);

[[nodiscard]] std::string encode_reply(const ControlReply& reply);

}  // namespace submapd
