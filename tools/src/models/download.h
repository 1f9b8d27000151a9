#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

#include "revisit/base/error.h"

namespace revisit::models {

/// No network, no such host or page, or a broken connection.
class DownloadError : public Error {
  using Error::Error;
};

struct DownloadOptions {
  std::function<void(int64_t done, int64_t total)> progress;  // [byte]; total 0: unknown
  std::function<bool()> stop;
  bool resume = true;
  int64_t most_bytes = int64_t{1} << 30;  // more is an error
  int slow_seconds = 60;  // time below 1000 bytes/s after which the connection is dead
};

struct DownloadResult {
  bool resumed = false;
};

/// Downloads `address` (http, https or file) into `part`, follows redirects, and resumes if the
/// server supports it. On return `part` is complete and on disk; it is kept on failure. The caller
/// must exclude other writers. Throws DownloadError with the reason, Interrupted on `stop`, and
/// Error if the file cannot be written or is a symbolic link.
DownloadResult download(const std::string& address, const std::filesystem::path& part,
                        const DownloadOptions& options = {});

/// Allowed protocols of a redirect from `address`, separated by commas: no local files, and only
/// https from https.
const char* redirect_protocols(const std::string& address);

}  // namespace revisit::models
