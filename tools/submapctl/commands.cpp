#include "tools/submapctl/commands.hpp"

#include <fmt/format.h>

namespace submapd::tools {

int report(std::string_view command, const Status& status) {
  fmt::print(stderr, "submapctl {}: {}\n", command, status.message());
  switch (status.code()) {
    case StatusCode::kUnavailable:
      return kLater;
    case StatusCode::kInvalidArgument:
    case StatusCode::kNotFound:
    case StatusCode::kCorrupt:
      return kBadInput;
    default:
      return kFailed;
  }
}

}  // namespace submapd::tools
