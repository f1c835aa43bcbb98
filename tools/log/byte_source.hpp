// Where a log's bytes come from: a file, memory, or another source unpacked on the fly.
//
// Pull interface, read front to back once. Not thread-safe: one reader owns its source.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>

#include "slam/base/status.hpp"

namespace submapd::tools {

class ByteSource {
 public:
  ByteSource() = default;
  ByteSource(const ByteSource&) = delete;
  ByteSource& operator=(const ByteSource&) = delete;
  virtual ~ByteSource() = default;

  // Fills the front of `into` and returns how many bytes that were; 0 is the end of the input. May return fewer than
  // asked for. kCorrupt: the packed form is damaged or cut short, everything before it has been delivered. kIo: the
  // operating system refused. After an error or the end it stays there.
  // REQUIRES: into is not empty.
  [[nodiscard]] virtual Expected<std::size_t> read(std::span<std::byte> into) = 0;

  // Share of the input that is used up, 0 to 1, if the last `unused_bytes` that were delivered are not; by packed bytes
  // where it is packed. 0 while the size is not known.
  [[nodiscard]] virtual double progress(std::size_t unused_bytes) const = 0;
};

// Opens a regular file, a pipe or a device. kNotFound, kIo (no permission, ...), kInvalidArgument (a folder).
[[nodiscard]] Expected<std::unique_ptr<ByteSource>> open_file(const std::string& path);

// Reads from memory. `bytes` must outlive the source.
[[nodiscard]] std::unique_ptr<ByteSource> open_memory(std::span<const std::byte> bytes);

}  // namespace submapd::tools
