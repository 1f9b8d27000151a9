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

/// Fetches `address` (http, https or file) into `part`, following redirects, and resumes if the
/// server can. On return `part` is complete and on disk; it stays if the work fails. The caller
/// excludes other writers. Throws DownloadError with the reason, Interrupted by `stop`, Error when
/// the file cannot be written or is a symbolic link.
DownloadResult download(const std::string& address, const std::filesystem::path& part,
                        const DownloadOptions& options = {});

/// Protocols of a redirect from `address`, with commas: never local files, from https only https.
const char* redirect_protocols(const std::string& address);

}  // namespace revisit::models
