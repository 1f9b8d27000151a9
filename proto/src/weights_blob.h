#pragma once

#include "revisit/base/files.h"
#include "revisit/proto/weights_file.h"

namespace revisit::proto {

/// Decodes the BlobProto at [begin, end) of a file, in any legal encoding: packed, unpacked or
/// chunked numbers, float or double, legacy or current shape, fields in any order; without those
/// numbers, raw_data. Skips gradients. Throws FormatError, also above kMaxElements.
Blob read_blob(FileCursor& cursor, uint64_t begin, uint64_t end);

}  // namespace revisit::proto
