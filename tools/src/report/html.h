#pragma once

#include <string>

#include "reports.pb.h"

namespace revisit::cli {

/// True when this build has a plotting library to embed; without, pages show static figures.
bool has_plot_library();

/// The page as one file that needs nothing else, also offline.
std::string html_page(const reports::Page& page);
/// In each such page, of earlier versions, too.
inline constexpr const char* kHtmlMark = "<main id=\"report\"></main>";

/// Text with the characters that HTML gives a meaning made plain.
std::string html_escaped(const std::string& text);

}  // namespace revisit::cli
