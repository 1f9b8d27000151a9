#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/proto/weights_file.h"

namespace revisit::proto {

inline constexpr uint64_t kMaxNpyHeader =
    64 * 1024;  ///< [bytes] NumPy writes a few hundred at most

/// Reads the header (versions 1-3) of a float32 array in C order and returns its shape; leaves the
/// cursor at the array. Throws InputError if the header is invalid or of another array.
std::vector<int64_t> read_npy_header(FileCursor& cursor);

/// Reads a NumPy .npy file (versions 1-3): float32 or float64 (converted), little-endian, C order.
/// Throws InputError with the finding: another dtype, Fortran order, a truncated file.
Blob read_npy(const std::filesystem::path& file);

/// Writes float32, C order, with write_atomically(). Throws UsageError for an invalid shape.
void write_npy(const std::filesystem::path& file, const std::vector<int64_t>& shape,
               const float* data);

/// Header for float32 in C order, padded to a multiple of 64 bytes; writers stream rows after it.
std::string npy_header(const std::vector<int64_t>& shape);

}  // namespace revisit::proto
