// What submapctl and submapd say to each other (control-protocol.md): one JSON object a packet.
//
// Pure functions; any thread.
#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
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

// `extra`: an object with what else there is to tell.
[[nodiscard]] std::string reply(const std::string& id, ReplyState state, const std::string& message,
                                nlohmann::json extra);
// kFailed, with what makes the asker's exit code.
[[nodiscard]] std::string refusal(const std::string& id, const Status& status);

}  // namespace submapd
