#include "slam/base/sha256.hpp"

#include <fmt/format.h>
#include <openssl/evp.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <memory>

namespace submapd {

Expected<Sha256> sha256_of(std::span<const std::byte> bytes) {
  Sha256 hash{};
  if (EVP_Digest(bytes.data(), bytes.size(), hash.data(), nullptr, EVP_sha256(), nullptr) != 1) {
    return failure(StatusCode::kInternal, "OpenSSL cannot compute a SHA-256; is its configuration sound?");
  }
  return hash;
}

Expected<Sha256> sha256_of_file(const std::filesystem::path& path) {
  const auto close = [](std::FILE* file) { std::fclose(file); };
  const std::unique_ptr<std::FILE, decltype(close)> file(std::fopen(path.c_str(), "rbe"), close);
  if (file == nullptr) {
    return failure(StatusCode::kIo, fmt::format("{}: cannot open: {}", path.string(), std::strerror(errno)));
  }
  const std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context(EVP_MD_CTX_new(), EVP_MD_CTX_free);
  bool good = context != nullptr && EVP_DigestInit_ex(context.get(), EVP_sha256(), nullptr) == 1;
  std::array<std::uint8_t, 65'536> piece{};
  while (good) {
    const std::size_t got = std::fread(piece.data(), 1, piece.size(), file.get());
    if (got == 0) break;
    good = EVP_DigestUpdate(context.get(), piece.data(), got) == 1;
  }
  if (std::ferror(file.get()) != 0) return failure(StatusCode::kIo, path.string() + ": cannot read");
  Sha256 hash{};
  if (!good || EVP_DigestFinal_ex(context.get(), hash.data(), nullptr) != 1) {
    return failure(StatusCode::kInternal, "OpenSSL cannot compute a SHA-256; is its configuration sound?");
  }
  return hash;
}

std::string hex_of(const Sha256& hash) {
  std::string text;
  for (const std::uint8_t byte : hash) text += fmt::format("{:02x}", byte);
  return text;
}

}  // namespace submapd
