#pragma once

#include "fuzz.h"

namespace revisit::fuzz {

/// Renders the page of `revisit report` from an untrusted file of loops or folder. If it succeeds,
/// requires that no content is markup and that the page's data are readable.
void make_page(const std::filesystem::path& place);

}  // namespace revisit::fuzz
