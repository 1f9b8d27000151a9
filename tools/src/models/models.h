#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "revisit/weights_conversion/known_models.h"

namespace revisit::cli {
struct NetOptions;
}

namespace revisit::models {

/// SHA-1 of a file in lower-case hexadecimal. Reads an unchanged file (path, size, inode, times)
/// once per process. Throws InputError if it cannot be read.
std::string file_sha1(const std::filesystem::path& file);

/// $REVISIT_MODELS, $XDG_CACHE_HOME/revisit/models or ~/.cache/revisit/models. Throws UsageError if
/// none of the variables is set.
std::filesystem::path cache_folder();

/// Regular files with one of the endings in a folder, or also below it; sorted.
std::vector<std::filesystem::path> files_in(const std::filesystem::path& folder,
                                            std::initializer_list<const char*> endings,
                                            bool below = false);
inline constexpr std::initializer_list<const char*> kWeights = {".caffemodel", ".caffemodel.h5"};

/// Weights of `model` in its folder of the cache: the file of its name, else the only caffemodel.
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
  std::filesystem::path file;  // existing or expected: <cache>/<name>/<file>
  uint64_t size = 0;           // [byte] on disk, of the partial file for kPartial
  std::string sha1;            // of the file; "" if it is absent or partial
};

/// Looks in the cache and among `loose` weights. Throws InputError for an unreadable file.
CacheEntry inspect(const std::filesystem::path& cache, const KnownModel& model,
                   const std::map<std::string, std::filesystem::path>& loose = {});

struct Fetched {
  std::filesystem::path file;
  std::filesystem::path prototxt;  // ours, or ""
  std::string sha1;
  bool verified = false;  // the checksum is the published one
  bool was_there = false;
};

/// End of a sentence: the command that fetches `model`, or the file to save in `cache`.
std::string how_to_get(const KnownModel& model, const std::filesystem::path& cache);

/// Downloads `model` into `cache` with the program curl, which prints its progress and errors to
/// standard error. The file gets its name if its checksum is the published one, or, without one, if
/// it is readable weights or a gzip archive. Resumes only downloads with a published checksum,
/// because others could mix two versions. Throws Error if the download fails or the checksums
/// differ (the download is removed), and Interrupted (FILE.part stays).
Fetched fetch_model(const KnownModel& model, const std::filesystem::path& cache);

/// `<cache>/<name>/deploy.prototxt`, the user's or ours, which is written; "" if we have none.
std::filesystem::path own_prototxt(const KnownModel& model, const std::filesystem::path& cache);

/// Empty options were not given.
struct ModelRequest {
  std::filesystem::path model;  // a prototxt, a folder with one, or a known model's name
  std::filesystem::path weights;
  std::string end;  // "conv3" or "conv3+pool5"
  std::optional<std::array<double, 3>> mean_bgr;
};

struct FoundModel {
  std::string name;  // of the known model, or in the prototxt
  std::filesystem::path prototxt, weights;
  std::string weights_sha1;
  std::array<double, 3> mean_bgr{};  // to be subtracted, 0 to 255
  std::string cut;                   // layer of the feature, given or suggested
  bool trained = true;               // false: from `revisit models make-random`
  std::vector<std::string> warnings;
};

/// Finds a network: the requested one, else the first known model in the cache, else the model in
/// $REVISIT_MODELS itself, if that is the folder of one model.
///
/// Looks for the weights beside a given prototxt, and vice versa: the same name, `deploy.prototxt`,
/// or the only one. A known model gets our prototxt (own_net()). Throws UsageError if there is no
/// model or several, and InputError for a missing file or a cached file with a wrong checksum.
FoundModel find_model(const ModelRequest& request);

/// Models in and below a folder ("": the cache), trained ones first; of models with one name only
/// the first. Warns of unusable caffemodels. Throws UsageError for a missing folder.
std::vector<FoundModel> all_models(const std::filesystem::path& folder);

/// Layers for features: those suggested for a known model, else the one that was found.
std::vector<std::string> cuts_of(const FoundModel& model);

struct ModelFiles {
  std::filesystem::path prototxt, weights;
};

/// Writes the inference layers of a prototxt with the engine's random weights to
/// `folder`/NAME_random.prototxt and .caffemodel, marked as untrained. `requested.prototxt` is a
/// file or the name of one of own_net(). Throws UsageError for an unknown name; InputError if the
/// file does not load, or if a caffemodel cannot hold or assign the weights.
ModelFiles write_random_model(const std::filesystem::path& folder,
                              const cli::NetOptions& requested);

/// Whether the name marks a net as untrained. Such a net must not be used to measure accuracy.
bool is_untrained(const std::string& net_name);

}  // namespace revisit::models
