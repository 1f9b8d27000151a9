#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "revisit/base/error.h"
#include "revisit/base/file_cursor.h"

namespace revisit::proto {

/// A dense array in C order.
struct NpyArray {
  std::vector<int64_t> shape;
  std::vector<float> data;
};

/// Header of a .npy file.
struct NpyHeader {
  std::string dtype;  // in NumPy's notation, e.g. "<f4"
  bool fortran_order = false;
  std::vector<int64_t> shape;
  uint64_t bytes = 0;  // size of the header, so the offset of the array
};

/// Maximum length of a header; NumPy writes a few hundred bytes at most.
inline constexpr uint64_t kMaxNpyHeader = 64 * 1024;

/// Parses the header of a NumPy .npy file (versions 1-3) at the cursor, and leaves the cursor at
/// the array. Throws InputError if the header is invalid.
NpyHeader read_npy_header(FileCursor& cursor);

/// Reads a NumPy .npy file (versions 1-3): float32 or float64 (converted), little-endian, C order.
/// Throws InputError with the finding: another dtype, Fortran order, a truncated file.
NpyArray read_npy(const std::filesystem::path& file);

/// Writes float32, C order, with write_atomically(). Throws UsageError for an invalid shape.
void write_npy(const std::filesystem::path& file, const std::vector<int64_t>& shape,
               const float* data);

/// Returns the header of a float32 C-order .npy with this shape, padded to a multiple of 64 bytes,
/// for writers that stream the rows after it.
std::string npy_header(const std::vector<int64_t>& shape);

}  // namespace revisit::proto
