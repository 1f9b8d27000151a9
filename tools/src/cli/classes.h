#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "revisit/engine/net.h"

namespace revisit::cli {

/// Lines of a file, the first for class 0, without the empty ones at its end. Or InputError.
std::vector<std::string> read_labels(const std::filesystem::path& file);

/// Names of the outputs with a number for each of `labels` classes of `file`; UsageError for none.
std::vector<std::string> classifying(const engine::Plan& plan, const std::filesystem::path& file,
                                     size_t labels);

/// Prints the five classes of each picture with the largest numbers of an output.
void print_best_classes(const std::string& name, std::span<const float> output,
                        const std::vector<std::string>& labels);

}  // namespace revisit::cli
