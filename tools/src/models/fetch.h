#pragma once

#include <filesystem>
#include <string>

#include "models/download.h"
#include "revisit/weights_conversion/known_models.h"

namespace revisit::models {

struct Fetched {
  std::filesystem::path file;      // the complete file in the cache
  std::filesystem::path prototxt;  // our own description beside it; "" when we have none that fits
  std::string sha1;
  bool verified = false;   // false: no checksum is known, or a doubtful one that differs
  bool was_there = false;  // nothing had to be downloaded
};

/// End of a sentence: the command that fetches `model`, else what to save where in `cache`.
std::string how_to_get(const KnownModel& model, const std::filesystem::path& cache);

/// Brings `model` into `cache`. The file gets its name when its checksum is the published one or,
/// without one, when it is readable weights or a whole gzip archive. Only a download with a
/// published checksum is resumed: others could mix two versions. Throws Error with the address and
/// place for the file when fetching fails, or with both sums when they differ (the download is
/// removed); Interrupted.
Fetched fetch_model(const KnownModel& model, const std::filesystem::path& cache,
                    const DownloadOptions& options = {});

}  // namespace revisit::models
