#pragma once

#include <filesystem>
#include <string>

#include "models/download.h"
#include "revisit/weights_conversion/known_models.h"

namespace revisit::models {

struct Fetched {
  std::filesystem::path file;
  std::filesystem::path prototxt;  // ours, or ""
  std::string sha1;
  bool verified = false;  // the checksum is the published one
  bool was_there = false;
};

/// End of a sentence: the command that fetches `model`, or the file to save in `cache`.
std::string how_to_get(const KnownModel& model, const std::filesystem::path& cache);

/// Downloads `model` into `cache`. The file gets its name if its checksum is the published one, or,
/// without one, if it is readable weights or a complete gzip archive. Resumes only downloads with a
/// published checksum, because others could mix two versions. Throws Error if the download fails or
/// the checksums differ (the download is removed), and Interrupted.
Fetched fetch_model(const KnownModel& model, const std::filesystem::path& cache,
                    const DownloadOptions& options = {});

}  // namespace revisit::models
