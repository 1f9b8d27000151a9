#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace revisit::cli {

std::string how_to_complete();

/// Throws UsageError naming `option` unless the optional library is built in.
void need_built_in(const std::string& option, std::string_view library);
/// The same for a map, which may be on a server.
void need_built_in_for_map(const std::string& option, const std::filesystem::path& map);

/// The optional libraries that are built in, and what does not work without the others.
std::string built_in_text();

}  // namespace revisit::cli
