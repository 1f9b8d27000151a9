#pragma once

#include <filesystem>
#include <functional>
#include <ostream>

#include "revisit/proto/error.h"

namespace revisit {

/// Writes a file so that it appears whole or not at all: `write` fills a temporary file beside it,
/// which is flushed to disk, checked and renamed. Throws Error naming the file and the reason
/// (no space, no permission); the temporary file is then removed.
void write_atomically(const std::filesystem::path& file,
                      const std::function<void(std::ostream&)>& write);

}  // namespace revisit
