#pragma once

#include <string_view>

namespace revisit::cli {

/// Orientation, 1 (upright) to 8, in the content of a JPEG file's marker APP1; 1 if there is none.
int exif_orientation(std::string_view marker);

}  // namespace revisit::cli
