#pragma once

#include <string>
#include <string_view>

namespace revisit::cli {

/// RFC 4648, with padding.
std::string base64(std::string_view bytes);

/// `data:<type>;base64,...`
std::string data_uri(const std::string& type, std::string_view bytes);

}  // namespace revisit::cli
