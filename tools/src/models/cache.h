#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "revisit/weights_conversion/known_models.h"

namespace revisit::models {

/// SHA-1 of a file in lower-case hexadecimal. Reads an unchanged file (path, size, inode, times)
/// once per process. Throws InputError if it cannot be read.
std::string file_sha1(const std::filesystem::path& file);

/// $REVISIT_MODELS, $XDG_CACHE_HOME/revisit/models or ~/.cache/revisit/models. Throws UsageError if
/// none of the variables is set.
std::filesystem::path cache_folder();

/// `<cache>/<name>/<file>`, fetched or saved by the user.
std::filesystem::path cached_file(const std::filesystem::path& cache, const KnownModel& model);

/// Regular files in a folder whose name `is_wanted`, sorted, without folders below it.
std::vector<std::filesystem::path> files_in(const std::filesystem::path& folder,
                                            bool (*is_wanted)(const std::string& name));
/// .caffemodel and .caffemodel.h5, sorted, without folders below it.
std::vector<std::filesystem::path> weights_in(const std::filesystem::path& folder);
std::vector<std::filesystem::path> weights_below(const std::filesystem::path& folder);

/// Weights of `model` in its cache folder: the file of its name, else the only caffemodel.
std::optional<std::filesystem::path> cached_weights(const std::filesystem::path& cache,
                                                    const KnownModel& model);

/// Caffemodels in the cache folder itself, which may be the folder of one model, by SHA-1.
std::map<std::string, std::filesystem::path> loose_weights(const std::filesystem::path& cache);

enum class CacheState {
  kAbsent,
  kPartial,     // `.part`: a fetch was interrupted
  kUnverified,  // apparently complete; no official checksum is known
  kVerified,
  kIncorrect,  // must not be used
};

const char* to_string(CacheState state);

struct CacheEntry {
  CacheState state = CacheState::kAbsent;
  std::filesystem::path file;  // existing or expected
  uint64_t size = 0;           // [byte] on disk, of the partial file for kPartial
  std::string sha1;            // of the file; "" if it is absent or partial
};

/// Looks in the cache and among `loose` weights. Throws InputError for an unreadable file.
CacheEntry inspect(const std::filesystem::path& cache, const KnownModel& model,
                   const std::map<std::string, std::filesystem::path>& loose = {});

}  // namespace revisit::models
