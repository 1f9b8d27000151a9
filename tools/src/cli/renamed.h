#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace revisit::cli {

/// A former name: works as before with a warning, and is in no help and no completion.
struct Renamed {
  std::string_view former, now;
  std::string_view where = {};
};

/// Former names of options. `where`: commands that have it, separated by commas; "" for all with
/// the option `now`.
std::span<const Renamed> renamed_options();
/// Former values. `where`: the option.
std::span<const Renamed> renamed_values();
/// Former commands. `where`: the program, "revisit" or "revisit map".
std::span<const Renamed> renamed_commands();

/// `command`: e.g. "revisit loops".
std::vector<std::string> former_options(const std::string& command, const std::string& option);
/// Current name, or `name` itself.
std::string current_option(const std::string& command, const std::string& name);
std::string current_value(const std::string& option, const std::string& value);
std::string current_command(const std::string& program, const std::string& name);

void warn_deprecated(const std::string& former, const std::string& now);

}  // namespace revisit::cli
