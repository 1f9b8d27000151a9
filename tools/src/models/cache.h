#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "revisit/weights_conversion/known_models.h"

namespace revisit::models {

/// $REVISIT_MODELS, $XDG_CACHE_HOME/revisit/models or ~/.cache/revisit/models; else UsageError.
std::filesystem::path cache_folder();

/// `<cache>/<name>/<file>`: where a model's download belongs, fetched or put there by hand.
std::filesystem::path cached_file(const std::filesystem::path& cache, const KnownModel& model);

/// The regular files in a folder whose name `is_wanted`, in order; not in folders below it.
std::vector<std::filesystem::path> files_in(const std::filesystem::path& folder,
                                            bool (*is_wanted)(const std::string& name));
/// The caffemodels (.caffemodel, .caffemodel.h5) in a folder, by name; not in folders below it.
std::vector<std::filesystem::path> weights_in(const std::filesystem::path& folder);
/// The same, in folders below it, too.
std::vector<std::filesystem::path> weights_below(const std::filesystem::path& folder);

/// The weights of `model` in its cache folder: the file of its own name, else the only caffemodel.
std::optional<std::filesystem::path> cached_weights(const std::filesystem::path& cache,
                                                    const KnownModel& model);

/// The caffemodels in the cache folder itself, by their sha1: it may be the folder of one model.
std::map<std::string, std::filesystem::path> loose_weights(const std::filesystem::path& cache);

enum class CacheState {
  kAbsent,
  kPartial,     // only the beginning, `.part`: a fetch was interrupted
  kUnverified,  // complete as far as one can tell: no checksum, or only a doubtful one, is known
  kVerified,    // the checksum is the published one
  kWrong,       // the checksum is not the published one: do not use
};

const char* to_string(CacheState state);

struct CacheEntry {
  CacheState state = CacheState::kAbsent;
  std::filesystem::path file;  // where it is or belongs
  uint64_t size = 0;           // [byte] on disk, of the partial file when that is all there is
  std::string sha1;            // as found; "" when absent or partial
};

/// Looks in the cache and among `loose` weights. Throws InputError for an unreadable file.
CacheEntry inspect(const std::filesystem::path& cache, const KnownModel& model,
                   const std::map<std::string, std::filesystem::path>& loose = {});

}  // namespace revisit::models
