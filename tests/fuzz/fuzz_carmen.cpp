// Any bytes as a log file, CARMEN text foremost; packed ones too.
#include <cstdint>

#include "tests/fuzz/read_log.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  submapd::tools::test::read_log(std::as_bytes(std::span(data, size)), nullptr);
  return 0;
}
