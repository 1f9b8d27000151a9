#pragma once

#include <string>

#include "revisit/pipeline/dataset.h"

namespace revisit::pipeline {

/// Identifies the files of a data set by path, size and time of change: reading them all would take
/// as long as describing them.
std::string dataset_key(const Dataset& dataset);

}  // namespace revisit::pipeline
