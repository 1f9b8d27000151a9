#pragma once

#include "revisit/proto/weights_file.h"

namespace revisit::proto {

bool is_hdf5(std::string_view head);

/// Opens weights in Caffe's HDF5 layout: an array `/data/LAYER/INDEX` for each blob.
std::unique_ptr<WeightsFile> open_hdf5(FileCursor cursor, const Limits& limits);

}  // namespace revisit::proto
