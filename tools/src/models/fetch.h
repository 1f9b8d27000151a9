#pragma once

#include <filesystem>
#include <string>

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

/// Downloads `model` into `cache` with the program curl, which prints its progress and errors to
/// standard error. The file gets its name if its checksum is the published one, or, without one, if
/// it is readable weights or a gzip archive. Resumes only downloads with a published checksum,
/// because others could mix two versions. Throws Error if the download fails or the checksums
/// differ (the download is removed), and Interrupted (FILE.part stays).
Fetched fetch_model(const KnownModel& model, const std::filesystem::path& cache);

/// `<cache>/<name>/deploy.prototxt`, the user's or ours, which is written; "" if we have none.
std::filesystem::path own_prototxt(const KnownModel& model, const std::filesystem::path& cache);

}  // namespace revisit::models
