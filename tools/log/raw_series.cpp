#include "tools/log/raw_series.hpp"

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

namespace submapd::tools {
namespace {

constexpr std::string_view kPrefix = "raw-";
constexpr std::string_view kSuffix = ".lcmlog";

std::optional<std::uint32_t> number_of(const std::filesystem::path& path) {
  const std::string name = path.filename().string();
  if (!name.starts_with(kPrefix) || !name.ends_with(kSuffix)) return std::nullopt;
  const char* const begin = name.data() + kPrefix.size();
  const char* const end = name.data() + name.size() - kSuffix.size();
  std::uint32_t number = 0;
  const auto parsed = std::from_chars(begin, end, number);
  return parsed.ec == std::errc() && parsed.ptr == end && end - begin >= 4 ? std::optional(number) : std::nullopt;
}

class SeriesSource final : public ByteSource {
 public:
  SeriesSource(std::vector<std::filesystem::path> files, std::unique_ptr<ByteSource> first)
      : files_(std::move(files)), source_(std::move(first)) {
    for (const std::filesystem::path& file : files_) {
      std::error_code error;
      const std::uintmax_t bytes = std::filesystem::file_size(file, error);
      if (!error) total_bytes_ += bytes;
    }
  }

  Expected<std::size_t> read(std::span<std::byte> into) override {
    for (;;) {
      Expected<std::size_t> got = source_->read(into);
      if (!got || *got > 0 || next_ == files_.size()) {
        if (got) read_bytes_ += *got;
        return got;
      }
      Expected<std::unique_ptr<ByteSource>> next = open_file(files_[next_].string());
      if (!next) return failure(next.error());
      source_ = std::move(*next);
      ++next_;
    }
  }
  double progress(std::size_t unused_bytes) const override {
    if (total_bytes_ == 0) return 0.0;
    const std::uintmax_t used = read_bytes_ - std::min<std::uintmax_t>(read_bytes_, unused_bytes);
    return std::min(static_cast<double>(used) / static_cast<double>(total_bytes_), 1.0);
  }

 private:
  const std::vector<std::filesystem::path> files_;
  std::unique_ptr<ByteSource> source_;
  std::size_t next_ = 1;
  std::uintmax_t total_bytes_ = 0;
  std::uintmax_t read_bytes_ = 0;
};

}  // namespace

std::vector<std::filesystem::path> raw_files_in(const std::filesystem::path& folder) {
  std::vector<std::pair<std::uint32_t, std::filesystem::path>> found;
  std::error_code error;
  for (auto entry = std::filesystem::directory_iterator(folder, error); !error && entry != end(entry);
       entry.increment(error)) {
    if (const auto number = number_of(entry->path())) found.emplace_back(*number, entry->path());
  }
  std::sort(found.begin(), found.end());
  std::vector<std::filesystem::path> files;
  for (auto& [number, path] : found) files.push_back(std::move(path));
  return files;
}

int next_raw_number(const std::vector<std::filesystem::path>& files) {
  return files.empty() ? 0 : static_cast<int>(number_of(files.back()).value_or(0)) + 1;
}

std::vector<std::filesystem::path> files_of_log(const std::filesystem::path& path) {
  std::vector<std::filesystem::path> files;
  std::error_code error;
  if (std::filesystem::is_directory(path, error)) files = raw_files_in(path);
  if (number_of(path) == 0U && std::filesystem::is_regular_file(path, error)) {
    files = raw_files_in(path.has_parent_path() ? path.parent_path() : ".");
  }
  return files.empty() ? std::vector{path} : files;
}

Expected<std::unique_ptr<ByteSource>> open_series(std::vector<std::filesystem::path> files) {
  Expected<std::unique_ptr<ByteSource>> first = open_file(files.front().string());
  if (!first || files.size() == 1) return first;
  return std::make_unique<SeriesSource>(std::move(files), std::move(*first));
}

}  // namespace submapd::tools
