// Errors as values: what went wrong, where, and what to do about it.
//
// Used by every room past start-up. Cheap to move; thread-compatible. Functions that can fail on input data return
// Status or Expected<T>; neither ever aborts or throws.
#pragma once

#include <string>
#include <tl/expected.hpp>
#include <utility>

namespace submapd {

enum class StatusCode {
  kOk,
  kInvalidArgument,  // the caller's or the user's input is wrong: tools exit with 2
  kCorrupt,          // bytes do not have the documented form
  kNotFound,
  kIo,           // the operating system refused: the message has its reason
  kExhausted,    // a pool or budget is full
  kUnavailable,  // try again later: tools exit with 75
  kInternal,     // a bug of ours or of a library
};

class [[nodiscard]] Status {
 public:
  Status() = default;
  Status(StatusCode code, std::string message) : code_(code), message_(std::move(message)) {}

  [[nodiscard]] bool ok() const { return code_ == StatusCode::kOk; }
  [[nodiscard]] StatusCode code() const { return code_; }
  [[nodiscard]] const std::string& message() const { return message_; }

 private:
  StatusCode code_ = StatusCode::kOk;
  std::string message_;
};

template <typename T>
using Expected = tl::expected<T, Status>;

// An Expected<T> in its error state: `return failure(StatusCode::kCorrupt, "...")`.
[[nodiscard]] inline tl::unexpected<Status> failure(StatusCode code, std::string message) {
  return tl::unexpected<Status>(Status(code, std::move(message)));
}
[[nodiscard]] inline tl::unexpected<Status> failure(Status status) {
  return tl::unexpected<Status>(std::move(status));
}

}  // namespace submapd
