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

/// How a user gets `model`, as the end of a sentence: the command that fetches it or, when
/// none can, what to save where in `cache`.
std::string how_to_get(const KnownModel& model, const std::filesystem::path& cache);

/// Brings `model` into `cache` and checks it. The file appears under its name only when it is
/// complete and its checksum is the published one, or, without one, when it can be read as a
/// weights file (or is a gzip archive, read to its end). An interrupted download is resumed, but
/// only with a published checksum: without one, a mixture of two versions could not be told from
/// the real file.
///
/// Throws Error with the address and the place to put the file by hand when it cannot be fetched;
/// with both sums when they differ (the download is then removed); Interrupted.
Fetched fetch_model(const KnownModel& model, const std::filesystem::path& cache,
                    const DownloadOptions& options = {});

}  // namespace revisit::models
