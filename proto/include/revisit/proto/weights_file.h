#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "revisit/base/error.h"
#include "revisit/base/file_cursor.h"
#include "revisit/proto/limits.h"

namespace revisit::proto {

/// One array of weights as a file holds it.
struct Blob {
  /// As stored. For `legacy_shape` always 4 values: num, channels, height, width; to be compared
  /// right-aligned with the last 4 axes of what a layer wants (docs/LAYERS.md point 8).
  std::vector<int64_t> shape;
  bool legacy_shape = false;
  /// Not in this file, though later blobs of the layer are: Caffe's HDF5 files keep an array that
  /// several layers share with the first of them only.
  bool absent = false;
  std::vector<float> data;
};

/// A weights file, indexed on opening, read layer by layer: blobs that nobody asks for are skipped
/// on disk (the wire format is length-prefixed).
class WeightsFile {
 public:
  struct Layer {
    std::string name;
    size_t n_blobs = 0;
  };

  virtual ~WeightsFile() = default;

  /// Opens a .caffemodel (V1 `layers` or V2 `layer`) or an HDF5 file of weights, by content. Reads
  /// names and positions only. Throws InputError with the byte offset for files that are neither,
  /// truncated, corrupt or beyond a limit; UnsupportedError for HDF5 that Caffe does not write.
  static std::unique_ptr<WeightsFile> open(const std::filesystem::path& file,
                                           const Limits& limits = {});
  /// The same of what a cursor reads.
  static std::unique_ptr<WeightsFile> open(FileCursor cursor, const Limits& limits = {});

  /// Its path, or what stands for it.
  const std::filesystem::path& file() const { return cursor_.file(); }

  /// The layers in file order. Names can repeat.
  const std::vector<Layer>& layers() const { return layers_; }

  /// The blobs of `layers()[index]`, for one thread at a time. Throws InputError (offset, layer,
  /// blob) for sizes that do not match the shape and for negative or overflowing dimensions.
  virtual std::vector<Blob> read(size_t index) = 0;

  /// Bytes actually read from the file so far.
  uint64_t bytes_read() const { return cursor_.bytes_read(); }

 protected:
  WeightsFile(FileCursor cursor, const Limits& limits)
      : cursor_(std::move(cursor)), limits_(limits) {}

  FileCursor cursor_;
  Limits limits_;
  std::vector<Layer> layers_;
};

/// Reads a .binaryproto: one blob, in Caffe the mean image of a training set. Throws InputError.
Blob read_binaryproto(const std::filesystem::path& file, const Limits& limits = {});

}  // namespace revisit::proto
