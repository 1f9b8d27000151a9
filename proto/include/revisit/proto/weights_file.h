#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/proto/limits.h"

namespace revisit::proto {

/// An array of a weights file.
struct Blob {
  /// Shape in the file. With `legacy_shape` always 4 values (num, channels, height, width), or 5 in
  /// files of C3D (with length), to be compared right-aligned with the last axes that a layer
  /// expects (docs/reference/LAYERS.md point 8).
  std::vector<int64_t> shape;
  bool legacy_shape = false;  ///< the file has num, channels, height, width
  /// True if the file lacks this blob but has later blobs of the layer. Caffe's HDF5 files store a
  /// shared array only with the first layer that uses it.
  bool absent = false;
  std::vector<float> data;  ///< [shape], C order; empty if absent
};

/// Indexed on opening and read layer by layer. Unused blobs are skipped on disk, because the wire
/// format is length-prefixed.
class WeightsFile {
 public:
  /// Index entry of a layer.
  struct Layer {
    std::string name;    ///< as in the file
    size_t n_blobs = 0;  ///< arrays that read() returns
  };

  virtual ~WeightsFile() = default;

  /// Opens a .caffemodel (V1 `layers` or V2 `layer`) or HDF5 weights, detected by content. Reads
  /// names and offsets only. Throws InputError with the byte offset if the file has another format,
  /// is truncated or corrupt, or exceeds a limit; UnsupportedError for HDF5 features that Caffe
  /// does not write.
  static std::unique_ptr<WeightsFile> open(const std::filesystem::path& file,
                                           const Limits& limits = {});
  /// Opens a file or memory likewise.
  static std::unique_ptr<WeightsFile> open(FileCursor cursor, const Limits& limits = {});

  /// The file's path, or the name given for it.
  const std::filesystem::path& file() const { return cursor_.file(); }

  /// Layers in file order. Names can repeat.
  const std::vector<Layer>& layers() const { return layers_; }

  /// Reads the blobs of `layers()[index]`. Not thread-safe. Throws InputError (offset, layer, blob)
  /// for sizes that do not match the shape and for negative or overflowing dimensions.
  virtual std::vector<Blob> read(size_t index) = 0;

  uint64_t bytes_read() const { return cursor_.bytes_read(); }  ///< from the disk so far

 protected:
  /// For the formats.
  WeightsFile(FileCursor cursor, const Limits& limits)
      : cursor_(std::move(cursor)), limits_(limits) {}

  FileCursor cursor_;          ///< the file
  Limits limits_;              ///< as given to open()
  std::vector<Layer> layers_;  ///< in file order
};

/// Reads a .binaryproto: one blob, in Caffe the mean image of a training set. Throws InputError.
Blob read_binaryproto(const std::filesystem::path& file, const Limits& limits = {});

}  // namespace revisit::proto
