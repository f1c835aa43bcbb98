#include "slam/base/sha256.hpp"

#include <openssl/evp.h>

namespace submapd {

Expected<Sha256> sha256_of(std::span<const std::byte> bytes) {
  Sha256 hash{};
  if (EVP_Digest(bytes.data(), bytes.size(), hash.data(), nullptr, EVP_sha256(), nullptr) != 1) {
    return failure(StatusCode::kInternal, "OpenSSL cannot compute a SHA-256; is its configuration sound?");
  }
  return hash;
}

}  // namespace submapd
