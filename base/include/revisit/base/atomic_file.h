#pragma once

#include <filesystem>
#include <functional>
#include <ostream>

#include "revisit/base/error.h"

namespace revisit {

/// What writing to a path does.
enum class Writing {
  kReplaces,  // a file that is new or takes the place of a regular one
  kStreams    // bytes into what is there: a FIFO, a character device, a descriptor of this process
};

/// What write_atomically() does at `file`, for programs that ask before long work. Throws
/// UsageError where it refuses: a folder, a block device, a socket, a circle of links.
Writing writing_of(const std::filesystem::path& file);

/// Writes a file so that it appears whole or not at all: `write` fills a temporary file beside it
/// (NAME.1.part), which is flushed to disk, checked and renamed. Behind a symbolic link the file it
/// names is replaced, and the link stays. The new file has the old one's permissions. What a writer
/// that was killed left at the same target is removed. Any number of threads and processes may
/// write at one target; the last one's file stays.
///
/// Only regular files are ever replaced: FIFOs, character devices (/dev/null) and descriptors of
/// this process (/dev/stdout) are written to as they are; UsageError refuses anything else.
///
/// Throws Error naming the file and the reason; the temporary file is then removed.
void write_atomically(const std::filesystem::path& file,
                      const std::function<void(std::ostream&)>& write);

/// Gives `temporary` the name `file`. Throws Error naming the reason, also when `file` is there and
/// is neither a regular file nor a symbolic link: nothing is renamed over a device, FIFO or folder.
void rename_into_place(const std::filesystem::path& temporary, const std::filesystem::path& file);

}  // namespace revisit
