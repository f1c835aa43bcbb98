// What went wrong in the driver, as a value: for calls off the path of the bytes, which may allocate a message.
#pragma once

#include <cstdint>
#include <string>
#include <tl/expected.hpp>
#include <utility>

namespace submapd::driver {

enum class ErrorCode : std::uint8_t {
  kInvalidArgument,  // the caller's
  kNotFound,         // no such device
  kBusy,             // another program holds the device
  kAccess,           // the permission is missing
  kDisconnected,     // the device went away
  kTimeout,          // the device does not answer
  kProtocol,         // it answers what it should not
  kSystem,           // the operating system refused: the message has its reason
};

struct Error {
  ErrorCode code = ErrorCode::kSystem;
  std::string message;  // what, where, and what to do
};

template <typename T>
using Expected = tl::expected<T, Error>;

// An Expected<T> in its error state: `return failure(ErrorCode::kTimeout, "...")`.
[[nodiscard]] inline tl::unexpected<Error> failure(ErrorCode code, std::string message) {
  return tl::unexpected<Error>(Error{code, std::move(message)});
}

}  // namespace submapd::driver
