#include "models/cache.h"

#include <openssl/evp.h>
#include <sys/stat.h>

#include <algorithm>
#include <cstdlib>
#include <memory>
#include <mutex>

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

fs::path environment_path(const char* name) {
  const char* const value = std::getenv(name);
  return value ? fs::path(value) : fs::path();
}

bool is_weights_name(const std::string& name) {
  return name.ends_with(".caffemodel") || name.ends_with(".caffemodel.h5");
}

template <class Iterator>
std::vector<fs::path> files_of(const fs::path& folder, bool (*is_wanted)(const std::string&)) {
  std::vector<fs::path> files;
  std::error_code error;
  for (Iterator entry(folder, error), end; !error && entry != end; entry.increment(error))
    if (entry->is_regular_file(error) && is_wanted(entry->path().filename().string()))
      files.push_back(entry->path());
  std::sort(files.begin(), files.end());
  return files;
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

fs::path cache_folder() {
  if (const fs::path models = environment_path("REVISIT_MODELS"); !models.empty()) return models;
  // The XDG specification requires to ignore a relative path.
  if (const fs::path xdg = environment_path("XDG_CACHE_HOME"); xdg.is_absolute())
    return xdg / "revisit" / "models";
  if (const fs::path home = environment_path("HOME"); !home.empty())
    return home / ".cache" / "revisit" / "models";
  throw UsageError("no folder for models, because HOME is not set; set REVISIT_MODELS");
}

fs::path cached_file(const fs::path& cache, const KnownModel& model) {
  return cache / model.name / model.file;
}

const char* to_string(CacheState state) {
  constexpr const char* kNames[] = {"absent", "partial", "unverified", "verified",
                                    "wrong checksum"};  // in the order of the enumeration
  return kNames[static_cast<size_t>(state)];
}

std::vector<fs::path> files_in(const fs::path& folder, bool (*is_wanted)(const std::string&)) {
  return files_of<fs::directory_iterator>(folder, is_wanted);
}

std::vector<fs::path> weights_in(const fs::path& folder) {
  return files_in(folder, is_weights_name);
}

std::vector<fs::path> weights_below(const fs::path& folder) {
  return files_of<fs::recursive_directory_iterator>(folder, is_weights_name);
}

std::optional<fs::path> cached_weights(const fs::path& cache, const KnownModel& model) {
  std::error_code none;
  if (const fs::path file = cached_file(cache, model);
      is_weights_name(model.file) && fs::is_regular_file(file, none))
    return file;
  const std::vector<fs::path> all = weights_in(cache / model.name);
  return all.size() == 1 ? std::optional(all[0]) : std::nullopt;
}

std::map<std::string, fs::path> loose_weights(const fs::path& cache) {
  std::map<std::string, fs::path> loose;
  for (const fs::path& file : weights_in(cache)) loose.emplace(file_sha1(file), file);
  return loose;
}

CacheEntry inspect(const fs::path& cache, const KnownModel& model,
                   const std::map<std::string, fs::path>& loose) {
  CacheEntry entry;
  entry.file = cached_file(cache, model);
  std::error_code none;
  const auto found = loose.find(model.sha1);
  if (const auto weights = cached_weights(cache, model); weights)
    entry.file = *weights;
  else if (!fs::is_regular_file(entry.file, none) && found != loose.end())
    entry.file = found->second;
  if (fs::is_regular_file(entry.file, none)) {
    entry.size = fs::file_size(entry.file);
    entry.sha1 = file_sha1(entry.file);
    entry.state = !model.sha1.empty() && model.sha1 == entry.sha1 ? CacheState::kVerified
                  : model.sha1.empty() || model.sha1_is_doubtful  ? CacheState::kUnverified
                                                                  : CacheState::kIncorrect;
  } else if (const fs::path part = entry.file.string() + ".part"; fs::exists(part, none)) {
    entry.size = fs::file_size(part, none);
    entry.state = CacheState::kPartial;
  }
  return entry;
}

}  // namespace revisit::models
