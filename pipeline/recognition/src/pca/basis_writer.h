#pragma once

#include <cstdint>
#include <filesystem>

namespace revisit {

/// Writes a float32 .npy `[rows][columns]` in blocks of columns, atomically.
class BasisWriter {
 public:
  /// Reserves the space. Throws Error if the disk has too little.
  BasisWriter(std::filesystem::path file, int64_t rows, int64_t columns);
  ~BasisWriter();  // without finish() the file is removed
  BasisWriter(const BasisWriter&) = delete;
  BasisWriter& operator=(const BasisWriter&) = delete;

  /// Writes columns [first, first + count) of all rows; `values` [rows][count].
  void write(int64_t first, int64_t count, const float* values);
  void finish();

 private:
  [[noreturn]] void fail(const char* doing, int reason) const;

  std::filesystem::path file_, part_;
  int64_t rows_, columns_, header_bytes_ = 0;
  int descriptor_ = -1;
};

}  // namespace revisit
