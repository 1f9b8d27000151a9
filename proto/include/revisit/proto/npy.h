#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "revisit/proto/error.h"

namespace revisit::proto {

/// A dense array in C order.
struct NpyArray {
  std::vector<int64_t> shape;
  std::vector<float> data;
};

/// Reads a NumPy .npy file (versions 1-3): float32 or float64 (converted), little-endian, C order.
/// Throws InputError naming what was found: another dtype, Fortran order, a truncated file.
NpyArray read_npy(const std::filesystem::path& file);

/// Writes float32, C order, as write_atomically() does. Throws Error, UsageError for a shape that
/// no file can have.
void write_npy(const std::filesystem::path& file, const std::vector<int64_t>& shape,
               const float* data);

/// The header of a float32 C-order .npy of this shape, padded to a multiple of 64 bytes: for
/// writers that stream the rows after it.
std::string npy_header(const std::vector<int64_t>& shape);

}  // namespace revisit::proto
