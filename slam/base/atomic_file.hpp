// A file that appears under its name whole and on the disk, or not at all (design section 6).
//
// Written under a temporary name in the same folder; commit() syncs it, renames it over `path` and syncs the folder.
// Without commit() the destructor removes the temporary. A temporary left by a crash is named `.NAME.PID.N.tmp`.
// Used from one thread; blocks on the disk.
#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <string_view>
#include <vector>

#include "slam/base/status.hpp"

namespace submapd {

class AtomicFile {
 public:
  // Creates the temporary; an error shows in the first write() or in commit(), as with every later error.
  explicit AtomicFile(std::filesystem::path path);
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;
  ~AtomicFile();

  // Appends. After the first error every call returns that error and writes nothing.
  Status write(std::span<const std::byte> bytes);
  Status write(std::string_view text) { return write(std::as_bytes(std::span(text))); }

  // Makes the file appear. Call at most once; a second call is an error.
  Status commit();

 private:
  Status fail(std::string_view step);
  void remove_temporary();

  std::filesystem::path path_;
  std::filesystem::path temporary_;  // empty: there is none
  int fd_ = -1;
  Status status_;  // the first error
};

// Puts the names in the folder on the disk.
[[nodiscard]] Status sync_folder(const std::filesystem::path& folder);

// The whole of `bytes` as the file `path`, with AtomicFile.
[[nodiscard]] Status atomic_write_file(const std::filesystem::path& path, std::span<const std::byte> bytes);

// The bytes of a regular file. Errors: kNotFound, kIo; kCorrupt if it has more than `most` bytes.
[[nodiscard]] Expected<std::vector<std::byte>> read_file(const std::filesystem::path& path,
                                                         std::size_t most = std::size_t{1} << 30);

}  // namespace submapd
