#include "tools/replay/recording.hpp"

#include <utility>

#include "proto/channels.hpp"

namespace submapd::tools {

Expected<Recording> open_recording(const std::string& log, const std::string& prefix) {
  // Filled while the reader looks for the first scan.
  const auto origin = std::make_shared<std::optional<ScanOrigin>>();
  const auto decoder = [channel = Channels(prefix).scan_h, origin](
                           std::string_view name, std::span<const std::byte> data) -> Expected<std::optional<Scan>> {
    if (name != channel) return std::optional<Scan>{};
    Expected<ScanMessage> message = decode_scan(data);
    if (!message) return tl::unexpected(message.error());
    if (!*origin && message->origin.run != Uuid{}) *origin = message->origin;
    return std::optional<Scan>(std::move(message->scan));
  };
  Expected<std::unique_ptr<LogReader>> reader = open_log(log, decoder);
  if (!reader) return failure(reader.error());
  return Recording{std::move(*reader), *origin};
}

}  // namespace submapd::tools
