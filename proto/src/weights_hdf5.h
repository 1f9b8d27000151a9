#pragma once

#include "revisit/proto/weights_file.h"

namespace revisit::proto {

/// Whether a file that begins like this is HDF5.
bool is_hdf5(std::string_view head);

/// Opens weights as Caffe keeps them in HDF5: an array `/data/LAYER/INDEX` for each blob.
std::unique_ptr<WeightsFile> open_hdf5(FileCursor cursor, const Limits& limits);

}  // namespace revisit::proto
