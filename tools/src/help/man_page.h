#pragma once

#include <string>

#include "cli/command_line.h"

namespace revisit::help {

/// The manual page of one command of `program` (which may be the program itself), for section 1.
std::string man_page(const cli::CommandLine& line, const cli::CommandLine& program);

/// Its name: "revisit-net-inspect.1".
std::string man_page_file(const cli::CommandLine& line);

}  // namespace revisit::help
