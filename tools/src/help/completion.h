#pragma once

#include <string>
#include <vector>

#include "cli/command_line.h"

namespace revisit::help {

/// The completion scripts of three shells for a program: commands, options, the words of values,
/// and else files or folders. They hold what the parsers say, and call nothing of the program.
std::string bash_completion(const cli::CommandLine& program);
std::string zsh_completion(const cli::CommandLine& program);
std::string fish_completion(const cli::CommandLine& program);

/// `help` in at most 70 characters, for lists; whole words.
std::string brief(const std::string& help);

/// As one word between single quotes, for bash and zsh.
std::string quoted(const std::string& text);

/// As the name of a function: "revisit_net_inspect", "revisit_models_make_random".
std::string identifier(const std::string& command);

/// What every script begins with: what it is and who wrote it.
std::string script_head(const std::string& shell);

}  // namespace revisit::help
