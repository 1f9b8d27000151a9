#pragma once

#include <functional>
#include <string>

#include "cli/command.h"

namespace revisit::cli {

/// The body of main(): interrupts, messages that are safe to print, and exit codes of errors.
/// `program` begins messages of errors; `run` gets the arguments without the program's name.
int run_main(const std::string& program, int argc, char** argv,
             const std::function<int(const Arguments&)>& run);

}  // namespace revisit::cli
