#pragma once

#include <filesystem>

namespace revisit {

/// Makes this process the only writer of `part`, a file that is renamed when complete. The lock
/// ends when `descriptor`, opened on the file, is closed, also by a kill. Throws Error if another
/// process is writing the file or has just finished it.
void lock_part(int descriptor, const std::filesystem::path& part);

}  // namespace revisit
