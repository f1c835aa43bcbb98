#include "tools/log/unpack.hpp"

#include <fmt/format.h>
#include <lzma.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <optional>

namespace submapd::tools {
namespace {

constexpr std::uint64_t kXzMemoryLimit = std::uint64_t{128} << 20;  // xz -9 needs 65 MiB
constexpr std::size_t kXzMagicSize = 6;

template <std::size_t N>
bool starts_with(std::span<const std::byte> front, const std::array<unsigned char, N>& magic) {
  return front.size() >= N && std::memcmp(front.data(), magic.data(), N) == 0;
}

// What gzip and xz share: the end of a stream is told once the bytes before it are delivered, and it stays the end.
class UnpackSource : public ByteSource {
 public:
  explicit UnpackSource(InputBuffer packed) : packed_(std::move(packed)) {}

  Expected<std::size_t> read(std::span<std::byte> into) final {
    if (!ended_) {
      const std::size_t produced = unpack(into);
      if (produced > 0) return produced;
    }
    if (!end_.ok()) return failure(end_);
    return 0;
  }

  double progress(std::size_t /*unused_bytes*/) const final { return packed_.progress(); }

 protected:
  // Unpacks at least one byte, or calls end() or damaged() first.
  virtual std::size_t unpack(std::span<std::byte> into) = 0;

  void end() { ended_ = true; }

  void damaged(const std::string& what) {
    ended_ = true;
    // The operating system's reason, if it has one, is the cause of ours.
    end_ = !packed_.status().ok()
               ? packed_.status()
               : Status(StatusCode::kCorrupt,
                        fmt::format("packed byte {}: {}; copy or pack the log again", packed_.offset(), what));
  }

  InputBuffer packed_;
  bool ended_ = false;

 private:
  Status end_;
};

class GzipSource final : public UnpackSource {
 public:
  using UnpackSource::UnpackSource;
  ~GzipSource() override {
    if (ready_) inflateEnd(&stream_);
  }

  bool set_up() {
    constexpr int kGzipOnly = 16;
    ready_ = inflateInit2(&stream_, MAX_WBITS + kGzipOnly) == Z_OK;
    return ready_;
  }

 private:
  std::size_t unpack(std::span<std::byte> into) override {
    const std::size_t room = std::min<std::size_t>(into.size(), std::numeric_limits<uInt>::max());
    stream_.next_out = reinterpret_cast<Bytef*>(into.data());
    stream_.avail_out = static_cast<uInt>(room);
    while (!ended_ && stream_.avail_out == room) {
      const auto input = packed_.peek(1);
      if (input.empty()) {
        if (between_members_) {
          packed_.status().ok() ? end() : damaged("");
        } else {
          damaged("the gzip stream is cut short");
        }
        break;
      }
      // zlib's next_in is not const for historical reasons; inflate does not write to it.
      stream_.next_in = reinterpret_cast<Bytef*>(const_cast<std::byte*>(input.data()));
      stream_.avail_in = static_cast<uInt>(input.size());
      const int result = inflate(&stream_, Z_NO_FLUSH);
      packed_.consume(input.size() - stream_.avail_in);
      between_members_ = result == Z_STREAM_END;
      if (between_members_) {
        inflateReset(&stream_);
      } else if (result != Z_OK) {
        damaged(
            fmt::format("the gzip stream is damaged ({})", stream_.msg != nullptr ? stream_.msg : "no reason given"));
      }
    }
    return room - stream_.avail_out;
  }

  z_stream stream_{};
  bool ready_ = false;
  bool between_members_ = false;
};

class XzSource final : public UnpackSource {
 public:
  using UnpackSource::UnpackSource;
  ~XzSource() override { lzma_end(&stream_); }

  bool set_up() { return lzma_stream_decoder(&stream_, kXzMemoryLimit, LZMA_CONCATENATED) == LZMA_OK; }

 private:
  std::size_t unpack(std::span<std::byte> into) override {
    stream_.next_out = reinterpret_cast<std::uint8_t*>(into.data());
    stream_.avail_out = into.size();
    while (!ended_ && stream_.avail_out == into.size()) {
      const auto input = packed_.peek(1);
      stream_.next_in = reinterpret_cast<const std::uint8_t*>(input.data());
      stream_.avail_in = input.size();
      const lzma_ret result = lzma_code(&stream_, input.empty() ? LZMA_FINISH : LZMA_RUN);
      packed_.consume(input.size() - stream_.avail_in);
      if (result == LZMA_STREAM_END) {
        end();
      } else if (result == LZMA_BUF_ERROR) {
        damaged("the xz stream is cut short");
      } else if (result == LZMA_MEMLIMIT_ERROR) {
        damaged(fmt::format("unpacking needs more than {} MiB (pack with xz -9 or less)", kXzMemoryLimit >> 20));
      } else if (result != LZMA_OK) {
        damaged(fmt::format("the xz stream is damaged (liblzma code {})", static_cast<int>(result)));
      }
    }
    return into.size() - stream_.avail_out;
  }

  lzma_stream stream_ = LZMA_STREAM_INIT;
};

template <typename Source>
Expected<std::unique_ptr<ByteSource>> open_unpacked(InputBuffer packed, const char* library) {
  auto source = std::make_unique<Source>(std::move(packed));
  if (!source->set_up()) {
    return failure(StatusCode::kInternal, fmt::format("{} cannot start to unpack; is memory short?", library));
  }
  return source;
}

}  // namespace

bool is_gzip(std::span<const std::byte> front) {
  return starts_with(front, std::array<unsigned char, 2>{0x1F, 0x8B});
}

bool is_xz(std::span<const std::byte> front) {
  return starts_with(front, std::array<unsigned char, kXzMagicSize>{0xFD, '7', 'z', 'X', 'Z', 0x00});
}

Expected<std::unique_ptr<ByteSource>> open_gzip(InputBuffer packed) {
  return open_unpacked<GzipSource>(std::move(packed), "zlib");
}

Expected<std::unique_ptr<ByteSource>> open_xz(InputBuffer packed) {
  return open_unpacked<XzSource>(std::move(packed), "liblzma");
}

}  // namespace submapd::tools
