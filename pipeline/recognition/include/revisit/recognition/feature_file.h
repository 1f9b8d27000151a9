#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>

#include "revisit/recognition/matrix.h"

namespace revisit::pipeline {

/// Streams features to a float32 .npy of `[n][d]`, and resumes where an earlier run was stopped.
///
/// Until finish() the rows are in `FILE.part`, beside `FILE.part.key`, a text that names all that
/// the features depend on. A part with the same key and shape is continued, any other is discarded.
/// A link or pipe in its place is an Error. The key of a finished file ends with its checksum.
///
///   if (!features_complete(file, key)) {
///     FeatureWriter writer(file, key, n, d);
///     for (int64_t i = writer.rows_written(); i < n; ++i) writer.append(describe(scan[i]));
///     writer.finish();
///   }
///   FeatureFile features(file);
class FeatureWriter {
 public:
  /// Opens or continues the part. Throws Error when the folder cannot be written, the disk is too
  /// full (naming bytes needed and free), or another process writes the same file.
  FeatureWriter(std::filesystem::path file, std::string key, int64_t n_rows, int64_t dim);
  ~FeatureWriter();  // without finish() the part stays, to be continued
  FeatureWriter(const FeatureWriter&) = delete;
  FeatureWriter& operator=(const FeatureWriter&) = delete;

  /// Complete rows in the part: the index of the next row to append.
  int64_t rows_written() const { return rows_; }
  /// Appends `dim` floats. Throws Error when the disk is full (the part stays) or sizes differ.
  void append(std::span<const float> row);
  /// Flushes to disk and names the file and `FILE.key`. Throws Error when rows are missing.
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
  uint64_t checksum_ = 0;  // of the rows so far
  int descriptor_ = -1;
};

/// True when `file` is finished, has this key, and all of it, which is read, has its checksum.
bool features_complete(const std::filesystem::path& file, const std::string& key);

/// A finished feature file, read-only. Movable, not copyable.
class FeatureFile {
 public:
  /// Throws InputError for anything but a whole float32 C-order .npy with two axes.
  explicit FeatureFile(std::filesystem::path file);
  ~FeatureFile();
  FeatureFile(FeatureFile&& other) noexcept;
  FeatureFile& operator=(FeatureFile&& other) noexcept;

  int64_t n() const { return n_; }
  int64_t d() const { return d_; }
  const std::filesystem::path& path() const { return file_; }
  /// Row i, memory-mapped: valid while this object lives and the file is not changed.
  std::span<const float> row(int64_t i) const { return {data_ + i * d_, static_cast<size_t>(d_)}; }
  /// The same of all rows; refers to this object.
  Rows rows() const {
    return {n_, d_, [this](int64_t i) { return row(i); }};
  }
  /// Copies `count` floats of row `i` from column `first` on, by reading the file: unlike row() the
  /// pages do not count as memory of this process. Throws InputError when the file became shorter.
  void read(int64_t i, int64_t first, int64_t count, float* out) const;

 private:
  void close() noexcept;

  std::filesystem::path file_;
  int64_t n_ = 0, d_ = 0, header_bytes_ = 0, mapped_bytes_ = 0;
  int descriptor_ = -1;
  void* mapping_ = nullptr;
  const float* data_ = nullptr;
};

}  // namespace revisit::pipeline
