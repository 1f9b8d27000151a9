#pragma once

#include "fuzz.h"

namespace revisit::fuzz {

/// Makes the page of `revisit report` of a file of loops or a folder, as a stranger gave it. If it
/// is accepted, nothing of it is markup in the page, and the page's data can be read.
void make_page(const std::filesystem::path& place);

}  // namespace revisit::fuzz
