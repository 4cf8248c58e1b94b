// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/common/sha256.h"

#include <openssl/evp.h>

#include <array>
#include <fstream>

#include "airslam/common/error.h"

namespace airslam {

struct Sha256::Impl {
  std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context{EVP_MD_CTX_new(),
                                                                  &EVP_MD_CTX_free};
};

Sha256::Sha256() : impl_(std::make_unique<Impl>()) {
  if (EVP_DigestInit_ex(impl_->context.get(), EVP_sha256(), nullptr) != 1) {
    Fail("OpenSSL offers no SHA-256");
  }
}

Sha256::~Sha256() = default;

void Sha256::Update(const void* data, std::size_t size) {
  if (EVP_DigestUpdate(impl_->context.get(), data, size) != 1) Fail("SHA-256 failed in OpenSSL");
}

std::string Sha256::Hex() {
  std::array<unsigned char, EVP_MAX_MD_SIZE> bytes;
  unsigned int size = 0;
  if (EVP_DigestFinal_ex(impl_->context.get(), bytes.data(), &size) != 1) {
    Fail("SHA-256 failed in OpenSSL");
  }
  std::string hex;
  for (unsigned int i = 0; i < size; ++i) hex += fmt::format("{:02x}", bytes[i]);
  return hex;
}

std::string FileSha256(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  Sha256 sha;
  std::array<char, 1 << 16> buffer;
  while (stream) {
    stream.read(buffer.data(), buffer.size());
    if (stream.gcount() > 0) sha.Update(buffer.data(), static_cast<std::size_t>(stream.gcount()));
  }
  if (!stream.eof()) Fail("cannot read {}", file.string());
  return sha.Hex();
}

}  // namespace airslam
