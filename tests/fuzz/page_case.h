#pragma once

#include "fuzz.h"

namespace revisit::fuzz {

/// Renders the page of `revisit report` from an untrusted file of loops or folder. If it is
/// accepted, none of its content may be markup in the page, and the page's data must be readable.
void make_page(const std::filesystem::path& place);

}  // namespace revisit::fuzz
