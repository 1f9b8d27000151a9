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

/// What a .npy file says about its array.
struct NpyHeader {
  std::string dtype;  // NumPy's, e.g. "<f4"
  bool fortran_order = false;
  std::vector<int64_t> shape;
  uint64_t bytes = 0;  // of the header: the array begins there
};

/// Headers that are longer are refused; NumPy itself stays below a few hundred bytes.
inline constexpr uint64_t kLongestNpyHeader = 64 * 1024;

/// Parses the header of a NumPy .npy file (versions 1-3) at the position of the cursor, which is
/// then at the array. Throws InputError for what is no such header.
NpyHeader read_npy_header(FileCursor& cursor);

/// Reads a NumPy .npy file (versions 1-3): float32 or float64 (converted), little-endian, C order.
/// Throws InputError naming what was found: another dtype, Fortran order, a truncated file.
NpyArray read_npy(const std::filesystem::path& file);

/// Writes float32, C order, as write_atomically() does. Throws UsageError for an impossible shape.
void write_npy(const std::filesystem::path& file, const std::vector<int64_t>& shape,
               const float* data);

/// The header of a float32 C-order .npy of this shape, padded to a multiple of 64 bytes: for
/// writers that stream the rows after it.
std::string npy_header(const std::vector<int64_t>& shape);

}  // namespace revisit::proto
