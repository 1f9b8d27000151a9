#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace revisit::cli {

/// Throws UsageError naming `option` unless the optional library is built in.
void need_built_in(const std::string& option, std::string_view library);
/// Throws UsageError for a map on a server without libpq.
void need_built_in_for_map(const std::string& option, const std::filesystem::path& map);

std::string built_in_text();

}  // namespace revisit::cli
