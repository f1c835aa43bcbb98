// decode_journal() on any bytes: no crash, and what it takes is what its records encode to.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <span>
#include <vector>

#include "daemon/run_journal.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto bytes = std::as_bytes(std::span(data, size));
  const auto contents = submapd::decode_journal(bytes);
  if (!contents) return 0;
  std::vector<std::byte> again = submapd::encode_journal_header(contents->cart, contents->run, contents->version);
  for (const submapd::JournalRecord& record : contents->records) {
    const std::vector<std::byte> more = submapd::encode_journal_record(record);
    again.insert(again.end(), more.begin(), more.end());
  }
  if (again.size() != contents->whole_bytes || std::memcmp(again.data(), data, again.size()) != 0) std::abort();
  return 0;
}
