// parse_request() on any bytes: no crash, and what is accepted has a name that cannot leave its folder.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "daemon/control_protocol.hpp"
#include "daemon/map_folder.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto request = submapd::parse_request({reinterpret_cast<const char*>(data), size});
  if (!request) {
    if (submapd::encode_reply(submapd::refusal("", request.error())).size() > submapd::kMaxReplyBytes) std::abort();
    return 0;
  }
  if (!request->name.empty() && !submapd::is_name(request->name)) std::abort();
  if (request->id.size() > 64) std::abort();
  return 0;
}
