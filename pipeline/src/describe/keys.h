#pragma once

#include <string>

#include "revisit/pipeline/dataset.h"

namespace revisit::pipeline {

/// A name for a text of any length, 16 hexadecimal digits. It does not protect: where it matters
/// the whole text is compared.
std::string short_name_of(const std::string& text);

/// Identifies the files of a data set by path, size and time of change: reading them all would take
/// as long as describing them.
std::string dataset_key(const Dataset& dataset);

}  // namespace revisit::pipeline
