// parse_configuration() on any bytes: no crash, an error names the file, and what is accepted lies within its range.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "daemon/configuration.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto parsed = submapd::parse_configuration(text, "fuzz.toml");
  if (!parsed) {
    if (parsed.error().message().rfind("fuzz.toml:", 0) != 0) std::abort();
    return 0;
  }
  const submapd::MapperOptions& m = parsed->mapper;
  const bool sound = m.particles >= 1 && m.particles <= 500 && m.keyframe_m >= 0.01 && m.keyframe_m <= 5.0 &&
                     m.map.cell_m >= 0.01 && m.map.cell_m <= 0.5 && m.distance_planes >= 500 &&
                     m.distance_planes <= 65535 && parsed->graph_bytes >= 1 << 16;
  if (!sound) std::abort();
  return 0;
}
