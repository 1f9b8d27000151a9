#pragma once

#include <filesystem>

#include "cli/command.h"

namespace revisit::cli {

/// The first positional argument of a command if it is a recording that only the Python package
/// reads: a bag, packets, or a folder with a bag; else "". Options that are not in `rows` are
/// taken for options of `revisit-loops`.
std::filesystem::path recording_in(const Arguments& arguments, const std::vector<Row>& rows);

/// Replaces the process by `revisit-loops` of the Python package, with the same arguments. Looks
/// for the interpreter $REVISIT_PYTHON, then for `revisit-loops` and `python3` on PATH. Throws
/// InputError naming the command to install and run if none has the package.
[[noreturn]] void run_python_loops(const std::filesystem::path& recording,
                                   const Arguments& arguments);

}  // namespace revisit::cli
