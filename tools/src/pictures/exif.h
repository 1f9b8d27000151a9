#pragma once

#include <string_view>

namespace revisit::cli {

/// How the camera was held: the orientation that EXIF gives, 1 (upright) to 8, in the content of a
/// JPEG file's marker APP1; 1 where the marker says none.
int exif_orientation(std::string_view marker);

}  // namespace revisit::cli
