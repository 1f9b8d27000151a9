#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "revisit/engine/net.h"

namespace revisit::cli {

/// Reads the lines of a file (the first is class 0) without empty lines at its end. Throws
/// InputError.
std::vector<std::string> read_labels(const std::filesystem::path& file);

/// Names of the outputs with a value for each of `labels` classes of `file`. Throws UsageError if
/// there is none.
std::vector<std::string> classifying(const engine::Plan& plan, const std::filesystem::path& file,
                                     size_t labels);

/// Prints the five classes of each picture with the largest values of an output.
void print_best_classes(const std::string& name, std::span<const float> output,
                        const std::vector<std::string>& labels);

}  // namespace revisit::cli
