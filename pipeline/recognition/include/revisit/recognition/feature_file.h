#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>

#include "revisit/recognition/matrix.h"

namespace revisit {

/// Streams features to a float32 .npy of `[n][d]`, and resumes after an interruption.
///
/// Before finish(), the rows are in `FILE.part`, and `FILE.part.key` has a text that identifies
/// everything the features depend on. A part with the same key and shape is resumed; any other part
/// is discarded. If a link or pipe is in its place, an Error is thrown. The key of a finished file
/// ends with its checksum.
///
///   if (!features_complete(file, key)) {
///     FeatureWriter writer(file, key, n, d);
///     for (int64_t i = writer.rows_written(); i < n; ++i) writer.append(describe(scan[i]));
///     writer.finish();
///   }
///   FeatureFile features(file);
class FeatureWriter {
 public:
  /// Opens or resumes the part. Throws Error if the folder is not writable, the disk has too little
  /// space (with bytes needed and free), or another process writes the same file.
  FeatureWriter(std::filesystem::path file, std::string key, int64_t n_rows, int64_t dim);
  ~FeatureWriter();  // without finish() the part stays and can be resumed
  FeatureWriter(const FeatureWriter&) = delete;
  FeatureWriter& operator=(const FeatureWriter&) = delete;

  /// Complete rows in the part, so the index of the next row.
  int64_t rows_written() const { return rows_; }
  /// Appends `dim` floats. Throws Error if the disk is full (the part stays) or the size is wrong.
  void append(std::span<const float> row);
  /// Flushes to disk, renames the part and writes `FILE.key`. Throws Error if rows are missing.
  void finish();

 private:
  void continue_or_create();
  bool continues_part(int64_t size) const;
  int64_t written_bytes() const;
  void check_space() const;
  [[noreturn]] void fail(const std::string& doing) const;

  std::filesystem::path file_, part_, part_key_;
  std::string key_, header_;
  int64_t n_rows_, dim_, rows_ = 0;
  uint64_t checksum_ = 0;
  int descriptor_ = -1;
};

/// Returns true if `file` is finished and has this key and a valid checksum. Reads the whole file.
bool features_complete(const std::filesystem::path& file, const std::string& key);

/// Read-only and memory-mapped. Movable, not copyable.
class FeatureFile {
 public:
  /// Throws InputError for anything but a complete float32 C-order .npy with two axes.
  explicit FeatureFile(std::filesystem::path file);
  ~FeatureFile();
  FeatureFile(FeatureFile&& other) noexcept;
  FeatureFile& operator=(FeatureFile&& other) noexcept;

  int64_t n() const { return n_; }
  int64_t d() const { return d_; }
  const std::filesystem::path& path() const { return file_; }
  /// Valid while this object lives and the file is not changed.
  std::span<const float> row(int64_t i) const { return {data_ + i * d_, static_cast<size_t>(d_)}; }
  /// Refers to this object.
  Rows rows() const {
    return {n_, d_, [this](int64_t i) { return row(i); }};
  }
  /// Reads `count` floats of row `i` from column `first` on. Unlike row(), the pages do not count
  /// as memory of this process. Throws InputError if the file was truncated.
  void read(int64_t i, int64_t first, int64_t count, float* out) const;

 private:
  void close() noexcept;

  std::filesystem::path file_;
  int64_t n_ = 0, d_ = 0, header_bytes_ = 0, mapped_bytes_ = 0;
  int descriptor_ = -1;
  void* mapping_ = nullptr;
  const float* data_ = nullptr;
};

}  // namespace revisit
