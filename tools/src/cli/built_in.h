#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace revisit::cli {

/// The command that builds the program with every library, in a clause.
std::string how_to_complete();

/// To be called where options are parsed, before any work. Throws UsageError that names `option`
/// and that command, unless the optional library of this name is built in.
void need_built_in(const std::string& option, std::string_view library);
/// The same for a map, which may be on a server.
void need_built_in_for_map(const std::string& option, const std::filesystem::path& map);

/// Lines for people: the optional libraries that are built in, and those that are left out, with
/// what does not work without them.
std::string built_in_text();

}  // namespace revisit::cli
