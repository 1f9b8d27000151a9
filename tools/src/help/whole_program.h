#pragma once

#include "cli/command_line.h"

namespace revisit::help {

/// The command line of `revisit` with all subcommands, as their parsers have it.
cli::CommandLine whole_program();

}  // namespace revisit::help
