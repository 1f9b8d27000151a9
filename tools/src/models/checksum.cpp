#include "models/checksum.h"

#include <openssl/evp.h>
#include <sys/stat.h>

#include <algorithm>
#include <map>
#include <memory>
#include <mutex>
#include <vector>

#include "revisit/base/error.h"
#include "revisit/base/files.h"

namespace revisit::models {

namespace {

namespace fs = std::filesystem;

std::string read_and_sum(const fs::path& file) {
  const std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context(EVP_MD_CTX_new(),
                                                                        EVP_MD_CTX_free);
  const EVP_MD* const digest = EVP_sha1();
  if (!context || !digest || EVP_DigestInit_ex(context.get(), digest, nullptr) != 1)
    throw Error("OpenSSL does not support SHA-1 on this system");

  FileCursor cursor(file);
  std::vector<char> block(size_t{1} << 20);
  while (cursor.position() < cursor.size()) {
    const auto count = std::min<uint64_t>(block.size(), cursor.size() - cursor.position());
    cursor.read(block.data(), count);
    if (EVP_DigestUpdate(context.get(), block.data(), count) != 1)
      throw Error("OpenSSL does not support SHA-1 on this system");
  }

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

/// Changes with the content; "" if the file cannot be examined.
std::string state_of(const fs::path& file) {
  struct stat s {};
  if (::stat(file.c_str(), &s) != 0) return "";
  return str(fs::absolute(file).string(), " ", s.st_dev, " ", s.st_ino, " ", s.st_size, " ",
             s.st_mtim.tv_sec, ".", s.st_mtim.tv_nsec, " ", s.st_ctim.tv_sec, ".",
             s.st_ctim.tv_nsec);
}

}  // namespace

std::string file_sha1(const fs::path& file) {
  static std::mutex mutex;
  static std::map<std::string, std::string> known;
  const std::string state = state_of(file);
  {
    const std::scoped_lock lock(mutex);
    if (const auto found = known.find(state); found != known.end()) return found->second;
  }
  const std::string sum = read_and_sum(file);
  const std::scoped_lock lock(mutex);
  if (state == state_of(file)) known[state] = sum;
  return sum;
}

}  // namespace revisit::models
