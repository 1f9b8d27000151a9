#pragma once

#include <filesystem>
#include <functional>
#include <ostream>

#include "revisit/base/error.h"

namespace revisit {

/// Effect of a write to a path.
enum class Writing {
  kReplaces,  // creates a file or replaces a regular one
  kStreams    // writes into an existing FIFO, character device or descriptor of this process
};

/// Effect of write_atomically() on `file`, for programs that check it before long work. Throws
/// UsageError if the target is a folder, a block device, a socket or a cycle of links.
Writing writing_of(const std::filesystem::path& file);

/// Writes a file atomically: `write` fills a temporary file in the same folder (NAME.1.part), which
/// is flushed to disk, checked and renamed. A symbolic link stays; its target is replaced. The new
/// file keeps the permissions of the old one. Temporary files that killed writers left for the same
/// target are removed. Any number of threads and processes may write to one target; the last one
/// wins.
///
/// Only regular files are replaced. FIFOs, character devices (/dev/null) and descriptors of this
/// process (/dev/stdout) are written directly. Other targets throw UsageError.
///
/// Throws Error with the file and the reason; the temporary file is then removed.
void write_atomically(const std::filesystem::path& file,
                      const std::function<void(std::ostream&)>& write);

/// Renames `temporary` to `file`. Throws Error with the reason. Existing files that are neither
/// regular nor symbolic links also throw, because a rename would destroy a device or FIFO.
void rename_into_place(const std::filesystem::path& temporary, const std::filesystem::path& file);

}  // namespace revisit
