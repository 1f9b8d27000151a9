#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

#include "revisit/base/error.h"

namespace revisit::models {

/// The address could not be reached or read: no network, no such host or page, a broken connection.
class DownloadError : public Error {
  using Error::Error;
};

struct DownloadOptions {
  std::function<void(int64_t done, int64_t total)> progress;  // [byte]; total 0: not known yet
  std::function<bool()> stop;                                 // true: stop soon
  bool resume = true;                     // go on behind what `part` holds; false: begin afresh
  int64_t most_bytes = int64_t{1} << 30;  // a server that sends more is not asked on
  int slow_seconds = 60;                  // that below 1000 bytes/s count as a dead connection
};

struct DownloadResult {
  bool resumed = false;  // part of the file is from an earlier call
};

/// Fetches `address` (http, https or file) into `part`, following redirects. What `part` already
/// holds is kept and only the rest is asked for; a server that cannot do that sends everything
/// again. On return `part` is complete and on disk; it stays as it is when the work fails.
///
/// Throws DownloadError with the reason, Interrupted when `stop` said so, Error when the file
/// cannot be written or is a symbolic link. The caller sees to it that nobody else writes `part`.
DownloadResult download(const std::string& address, const std::filesystem::path& part,
                        const DownloadOptions& options = {});

/// Where a server may point us on from `address`: not to local files, and from https not to what
/// anyone on the way can change. Names of protocols with commas between.
const char* redirect_protocols(const std::string& address);

}  // namespace revisit::models
