#include "daemon/control_protocol.hpp"

#include <fmt/format.h>

#include <array>
#include <nlohmann/json.hpp>

#include "daemon/map_folder.hpp"

namespace submapd {
namespace {

constexpr std::size_t kLongestId = 64;

struct NamedVerb {
  const char* name;
  ControlVerb verb;
};
constexpr std::array<NamedVerb, 8> kVerbs = {{{"status", ControlVerb::kStatus},
                                              {"health", ControlVerb::kHealth},
                                              {"save-map", ControlVerb::kSaveMap},
                                              {"get-map", ControlVerb::kGetMap},
                                              {"mark", ControlVerb::kMark},
                                              {"pause", ControlVerb::kPause},
                                              {"resume", ControlVerb::kResume},
                                              {"new-run", ControlVerb::kNewRun}}};

tl::unexpected<Status> wrong(const std::string& what) {
  return failure(StatusCode::kInvalidArgument, what);
}

// Sets the field of one key; false if the key is unknown or the value is not of its type.
bool take(const std::string& key, const nlohmann::json& value, ControlRequest& request) {
  if (key == "id" && value.is_string()) {
    request.id = value.get<std::string>();
  } else if (key == "name" && value.is_string()) {
    request.name = value.get<std::string>();
  } else if (key == "wait" && value.is_boolean()) {
    request.wait = value.get<bool>();
  } else if (key == "force" && value.is_boolean()) {
    request.force = value.get<bool>();
  } else if (key == "cloud" && value.is_boolean()) {
    request.cloud = value.get<bool>();
  } else if (key == "utime_us" && value.is_number_integer() && !value.is_number_unsigned()) {
    request.utime_us = value.get<std::int64_t>();
  } else if (key == "utime_us" && value.is_number_unsigned() && value.get<std::uint64_t>() <= INT64_MAX) {
    request.utime_us = value.get<std::int64_t>();
  } else {
    return false;
  }
  return true;
}

// JSON for UTF-8 and for whatever else came in a name.
std::string dump(const nlohmann::json& json) {
  return json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

}  // namespace

const char* verb_name(ControlVerb verb) {
  for (const NamedVerb& known : kVerbs) {
    if (known.verb == verb) return known.name;
  }
  return "";
}

Expected<ControlRequest> parse_request(std::string_view packet) {
  if (packet.size() > kMaxRequestBytes) return wrong(fmt::format("a request has at most {} bytes", kMaxRequestBytes));
  // No exceptions; the parser does not recurse.
  const nlohmann::json json = nlohmann::json::parse(packet, nullptr, false);
  if (!json.is_object()) return wrong("a request is one JSON object");
  ControlRequest request;
  bool has_verb = false;
  for (const auto& [key, value] : json.items()) {
    if (key == "verb" && value.is_string()) {
      for (const NamedVerb& known : kVerbs) {
        if (value.get_ref<const std::string&>() != known.name) continue;
        request.verb = known.verb;
        has_verb = true;
      }
      if (!has_verb)
        return wrong("unknown verb; known are status, health, save-map, get-map, mark, pause, resume, new-run");
    } else if (!take(key, value, request)) {
      return wrong("unknown key, or a value of another type; see control-protocol.md");
    }
  }
  if (!has_verb) return wrong("a request needs a verb");
  if (request.id.size() > kLongestId) return wrong(fmt::format("an id has at most {} characters", kLongestId));
  const bool named = request.verb == ControlVerb::kMark || !request.name.empty();
  if (named && !is_name(request.name)) {
    return wrong(kNameRule);
  }
  return request;
}

ControlReply refusal(const std::string& id, const Status& status) {
  return {id, ReplyState::kFailed, status.message(), status.code(), nlohmann::json::object()};
}

Refusal reason_of(const ControlReply& reply) {
  if (reply.code == StatusCode::kInvalidArgument || reply.code == StatusCode::kNotFound) return Refusal::kInput;
  return reply.code == StatusCode::kUnavailable ? Refusal::kLater : Refusal::kOther;
}

std::string encode_reply(const ControlReply& reply) {
  constexpr std::array<const char*, 3> kStates = {"done", "working", "failed"};
  constexpr std::array<const char*, 3> kReasons = {"input", "later", "failed"};
  nlohmann::json json = reply.extra;
  json["id"] = reply.id;
  json["state"] = kStates[static_cast<std::size_t>(reply.state)];
  json["message"] = reply.message;
  if (reply.state == ReplyState::kFailed) json["reason"] = kReasons[static_cast<std::size_t>(reason_of(reply))];
  return dump(json);
}

}  // namespace submapd
