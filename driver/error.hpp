// Why a call of the driver failed: what kind of trouble, and words for a person.
#pragma once

#include <cstdint>
#include <string>
#include <tl/expected.hpp>
#include <utility>

namespace submapd::driver {

enum class ErrorCode : std::uint8_t {
  kInvalidArgument,  // the caller's or the user's input is wrong
  kNotFound,         // no such device
  kNoPermission,     // the system does not let us
  kBusy,             // somebody else has it
  kUnsupported,      // the device or the system cannot do that
  kIo,               // the system or the device refused: the message has its reason
};

struct Error {
  ErrorCode code = ErrorCode::kIo;
  std::string message;  // what, where, and what to do about it
};

template <typename T>
using Result = tl::expected<T, Error>;

[[nodiscard]] inline tl::unexpected<Error> failure(ErrorCode code, std::string message) {
  return tl::unexpected<Error>(Error{code, std::move(message)});
}

}  // namespace submapd::driver
