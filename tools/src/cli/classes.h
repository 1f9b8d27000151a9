#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "revisit/engine/net.h"

namespace revisit::cli {

/// Line 1 is the label of class 0. Skips empty lines at the end. Throws InputError.
std::vector<std::string> read_labels(const std::filesystem::path& file);

/// Outputs with `labels` values per picture. Throws UsageError naming `file` if there is none.
std::vector<std::string> classifying(const engine::Plan& plan, const std::filesystem::path& file,
                                     size_t labels);

/// Prints the five largest values of each picture. `output`: [pictures][labels].
void print_best_classes(const std::string& name, std::span<const float> output,
                        const std::vector<std::string>& labels);

}  // namespace revisit::cli
