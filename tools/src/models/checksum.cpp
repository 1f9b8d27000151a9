#include "models/checksum.h"

#include <openssl/evp.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <memory>
#include <vector>

#include "revisit/proto/error.h"

namespace revisit::models {

std::string file_checksum(const std::filesystem::path& file, const char* algorithm) {
  const std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context(EVP_MD_CTX_new(),
                                                                        EVP_MD_CTX_free);
  const EVP_MD* const digest = EVP_get_digestbyname(algorithm);
  if (!context || !digest || EVP_DigestInit_ex(context.get(), digest, nullptr) != 1)
    throw Error(str("OpenSSL cannot compute '", algorithm, "' here"));

  errno = 0;
  std::ifstream in(file, std::ios::binary);
  std::vector<char> block(size_t{1} << 20);
  while (in) {
    in.read(block.data(), static_cast<std::streamsize>(block.size()));
    const auto count = static_cast<size_t>(in.gcount());
    if (count && EVP_DigestUpdate(context.get(), block.data(), count) != 1)
      throw Error(str("OpenSSL cannot compute '", algorithm, "' here"));
  }
  if (!in.eof() || in.bad())
    throw InputError(
        str(file.string(), ": cannot read: ", errno ? std::strerror(errno) : "read error"));

  unsigned char sum[EVP_MAX_MD_SIZE];
  unsigned int length = 0;
  EVP_DigestFinal_ex(context.get(), sum, &length);
  std::string text;
  for (unsigned int i = 0; i < length; ++i) {
    text += "0123456789abcdef"[sum[i] >> 4];
    text += "0123456789abcdef"[sum[i] & 15];
  }
  return text;
}

}  // namespace revisit::models
