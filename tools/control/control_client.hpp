// Asks a running submapd over its control socket (daemon/control-protocol.md). One thread.
#pragma once

#include <chrono>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "slam/base/status.hpp"

namespace submapd::tools {

class ControlClient {
 public:
  // Errors: kUnavailable (no daemon there), kIo (no permission), with what helps.
  [[nodiscard]] static Expected<ControlClient> connect(const std::string& path);
  ControlClient(ControlClient&& other) noexcept;
  ControlClient& operator=(ControlClient&&) = delete;
  ~ControlClient();

  Status send(const nlohmann::json& request);
  // The next reply. Errors: kUnavailable (none within `patience`, or the daemon has gone), kInternal (no answer of
  // ours).
  [[nodiscard]] Expected<nlohmann::json> receive(std::chrono::milliseconds patience);
  // The open file that came with the last reply, which is the caller's from now on; -1: none.
  [[nodiscard]] int take_file();
  [[nodiscard]] Expected<nlohmann::json> ask(const nlohmann::json& request);

 private:
  explicit ControlClient(int fd) : fd_(fd) {}
  int fd_;
  int file_ = -1;
};

// A reply's text field, empty if there is none.
[[nodiscard]] std::string text_of(const nlohmann::json& reply, const char* key);

// The terminal screen of `submapctl monitor`, from the daemon's health object.
[[nodiscard]] std::string screen_of(const nlohmann::json& health);

}  // namespace submapd::tools
