#pragma once

#include <filesystem>
#include <functional>
#include <ostream>

#include "revisit/base/error.h"

namespace revisit {

/// How write_atomically() writes a target.
enum class Writing {
  kReplaces,  // creates or replaces a regular file
  kStreams,   // writes into a FIFO, a character device or a descriptor of this process
};

/// Checks the target before long work. Throws UsageError if it is a folder, a block device, a
/// socket or a cycle of links.
Writing writing_of(const std::filesystem::path& file);

/// Writes a file atomically: fills a temporary file in the same folder (NAME.1.part), flushes it to
/// disk and renames it. A symbolic link stays; its target is replaced. The new file keeps the
/// permissions of the old one. Temporary files that killed writers left for the same target are
/// removed. Any number of threads and processes may write to one target; the last one wins. FIFOs,
/// character devices (/dev/null) and descriptors of this process (/dev/stdout) are written
/// directly. Throws UsageError as writing_of(), and Error with the file and the reason; the
/// temporary file is then removed.
void write_atomically(const std::filesystem::path& file,
                      const std::function<void(std::ostream&)>& write);

/// Throws Error with the reason, also if `file` is neither regular nor a symbolic link, because a
/// rename would destroy a device or FIFO.
void rename_into_place(const std::filesystem::path& temporary, const std::filesystem::path& file);

}  // namespace revisit
