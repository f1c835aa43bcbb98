#include "daemon/run_folder.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <sys/random.h>

#include <cerrno>
#include <cstring>
#include <ctime>
#include <fstream>
#include <optional>
#include <system_error>

#include "slam/base/atomic_file.hpp"

namespace submapd {
namespace {

// RFC 4122, version 4.
Expected<Uuid> random_uuid() {
  Uuid id;
  if (::getrandom(id.bytes.data(), id.bytes.size(), 0) != static_cast<ssize_t>(id.bytes.size())) {
    return failure(StatusCode::kIo, fmt::format("cannot get random bytes: {}", std::strerror(errno)));
  }
  id.bytes[6] = static_cast<std::uint8_t>((id.bytes[6] & 0x0F) | 0x40);
  id.bytes[8] = static_cast<std::uint8_t>((id.bytes[8] & 0x3F) | 0x80);
  return id;
}

std::optional<Uuid> parse_uuid(const std::string& text) {
  Uuid id;
  std::size_t digits = 0;
  for (const char c : text) {
    if (c == '-') continue;
    const int value = c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1;
    if (value < 0 || digits == 32) return std::nullopt;
    std::uint8_t& byte = id.bytes[digits++ / 2];
    byte = static_cast<std::uint8_t>(byte * 16 + value);
  }
  return digits == 32 && id.to_string() == text ? std::optional(id) : std::nullopt;
}

Expected<Uuid> identity_of_cart(const std::filesystem::path& path) {
  std::ifstream file(path);
  if (file) {
    std::string text;
    std::getline(file, text);
    if (const std::optional<Uuid> id = parse_uuid(text)) return *id;
    return failure(StatusCode::kCorrupt,
                   fmt::format("{}: does not hold a UUID; delete it and the cart gets a new identity", path.string()));
  }
  const Expected<Uuid> id = random_uuid();
  if (!id) return id;
  const std::string text = id->to_string() + "\n";
  if (Status status = atomic_write_file(path, std::as_bytes(std::span(text))); !status.ok()) return failure(status);
  return id;
}

Status make_current(const RunFolder& folder, const std::filesystem::path& state) {
  std::error_code error;
  for (const std::filesystem::path& made : {folder.path, folder.submaps(), folder.maps()}) {
    std::filesystem::create_directory(made, error);
    if (error) return {StatusCode::kIo, fmt::format("cannot make {}: {}", made.string(), error.message())};
  }
  for (const std::filesystem::path& synced : {folder.path, state / "runs"}) {
    if (Status status = sync_folder(synced); !status.ok()) return status;
  }
  const std::string current = folder.name + "\n";
  return atomic_write_file(state / "current-run", std::as_bytes(std::span(current)));
}

}  // namespace

Expected<RunFolder> begin_run(const std::filesystem::path& state, const RunClock& clock) {
  std::error_code error;
  std::filesystem::create_directories(state / "runs", error);
  if (error) {
    return failure(StatusCode::kIo,
                   fmt::format("cannot make {}: {}; set [daemon] state to a folder that can be written",
                               (state / "runs").string(), error.message()));
  }
  RunFolder folder;
  const Expected<Uuid> cart = identity_of_cart(state / "cart-uuid");
  if (!cart) return failure(cart.error());
  const Expected<Uuid> run = random_uuid();
  if (!run) return failure(run.error());
  folder.cart = *cart;
  folder.run = *run;
  folder.clock = clock;
  const std::time_t seconds = RunClock::now().utime_us() / 1'000'000;  // of the system, also for a log's scans
  folder.name = fmt::format("{:%Y%m%d-%H%M%S}-{}", fmt::gmtime(seconds), run->to_string().substr(0, 4));
  folder.path = state / "runs" / folder.name;
  if (Status status = make_current(folder, state); !status.ok()) {
    discard_run(folder);
    return failure(status);
  }
  return folder;
}

void discard_run(const RunFolder& folder) {
  std::error_code error;
  std::filesystem::remove_all(folder.path, error);
}

}  // namespace submapd
