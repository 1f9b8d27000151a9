#pragma once

#include <filesystem>

namespace revisit {

/// Makes this process the only writer of `part`, a file that gets its final name when it is whole;
/// the lock goes when `descriptor`, opened on it, is closed, also by a kill. Throws Error when
/// another process writes it or has just finished it.
void lock_part(int descriptor, const std::filesystem::path& part);

}  // namespace revisit
