#include "models/download.h"

#include <curl/curl.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <memory>

namespace revisit::models {
namespace {

namespace fs = std::filesystem;

class PartFile {
 public:
  explicit PartFile(const fs::path& path) : path_(path) {
    descriptor_ = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0666);
    if (descriptor_ < 0 && errno == ELOOP)
      throw Error(path.string() + ": the download does not follow a symbolic link; remove it");
    if (descriptor_ < 0) fail("create");
  }
  ~PartFile() { ::close(descriptor_); }
  PartFile(const PartFile&) = delete;
  PartFile& operator=(const PartFile&) = delete;

  int64_t size() const {
    struct stat status {};
    if (::fstat(descriptor_, &status) != 0) fail("examine");
    return status.st_size;
  }
  void truncate() {
    if (::ftruncate(descriptor_, 0) != 0) fail("empty");
  }
  /// Returns false with errno if not everything was written.
  bool append(const char* data, size_t count) {
    if (::lseek(descriptor_, 0, SEEK_END) < 0) return false;
    while (count > 0) {
      const ssize_t written = ::write(descriptor_, data, count);
      if (written < 0 && errno == EINTR) continue;
      if (written < 0) return false;
      data += written;
      count -= static_cast<size_t>(written);
    }
    return true;
  }
  void sync() {
    if (::fsync(descriptor_) != 0 && errno != EINVAL) fail("write");
  }

 private:
  [[noreturn]] void fail(const char* doing) const {
    throw Error(path_.string(), ": cannot ", doing, ": ", std::strerror(errno));
  }
  fs::path path_;
  int descriptor_ = -1;
};

struct Transfer {
  const DownloadOptions& options;
  PartFile& part;
  int64_t kept;          // [byte] in the file before this transfer
  int64_t received = 0;  // [byte] in this transfer
  int write_error = 0;
};

bool is_too_much(const Transfer& transfer, int64_t received) {
  return transfer.kept + received > transfer.options.most_bytes;
}

size_t on_data(char* data, size_t, size_t count, void* user) {
  auto& transfer = *static_cast<Transfer*>(user);
  transfer.received += static_cast<int64_t>(count);
  if (is_too_much(transfer, transfer.received)) return 0;
  if (transfer.part.append(data, count)) return count;
  transfer.write_error = errno;
  return 0;
}

int on_progress(void* user, curl_off_t total, curl_off_t done, curl_off_t, curl_off_t) {
  const auto& transfer = *static_cast<const Transfer*>(user);
  if (transfer.options.progress && done > 0)
    transfer.options.progress(transfer.kept + done, total > 0 ? transfer.kept + total : 0);
  return transfer.options.stop && transfer.options.stop() ? 1 : 0;
}

struct Outcome {
  CURLcode code;
  long status;  // HTTP status, 0 for a file
  std::string reason;
  int write_error;
  bool too_much;
};

Outcome transfer_once(const std::string& address, PartFile& part, const DownloadOptions& options) {
  static const CURLcode initialized = curl_global_init(CURL_GLOBAL_DEFAULT);
  const std::unique_ptr<CURL, decltype(&curl_easy_cleanup)> curl(curl_easy_init(),
                                                                 curl_easy_cleanup);
  if (initialized != CURLE_OK || !curl) throw Error("cannot initialize libcurl");

  Transfer transfer{options, part, part.size()};
  char reason[CURL_ERROR_SIZE] = "";
  const auto set = [&curl](CURLoption option, auto value) {
    const CURLcode code = curl_easy_setopt(curl.get(), option, value);
    if (code != CURLE_OK) throw Error("libcurl: ", curl_easy_strerror(code));
  };
  set(CURLOPT_URL, address.c_str());
  set(CURLOPT_PROTOCOLS_STR, "http,https,file");
  set(CURLOPT_REDIR_PROTOCOLS_STR, redirect_protocols(address));
  set(CURLOPT_FOLLOWLOCATION, 1L);
  set(CURLOPT_MAXREDIRS, 10L);
  set(CURLOPT_FAILONERROR, 1L);
  set(CURLOPT_NOSIGNAL, 1L);
  set(CURLOPT_USERAGENT, "revisit");
  set(CURLOPT_CONNECTTIMEOUT, 20L);
  set(CURLOPT_LOW_SPEED_LIMIT, 1000L);  // [byte/s]
  set(CURLOPT_LOW_SPEED_TIME, static_cast<long>(options.slow_seconds));
  set(CURLOPT_ERRORBUFFER, reason);
  set(CURLOPT_RESUME_FROM_LARGE, static_cast<curl_off_t>(transfer.kept));
  set(CURLOPT_WRITEFUNCTION, on_data);
  set(CURLOPT_WRITEDATA, &transfer);
  set(CURLOPT_NOPROGRESS, 0L);
  set(CURLOPT_XFERINFOFUNCTION, on_progress);
  set(CURLOPT_XFERINFODATA, &transfer);

  Outcome outcome{curl_easy_perform(curl.get()), 0, "", transfer.write_error,
                  is_too_much(transfer, transfer.received)};
  curl_easy_getinfo(curl.get(), CURLINFO_RESPONSE_CODE, &outcome.status);
  outcome.reason = *reason ? reason : curl_easy_strerror(outcome.code);
  return outcome;
}

/// The server ignores ranges, or has no more bytes than `part`.
bool cannot_resume(const Outcome& outcome) {
  return outcome.code == CURLE_RANGE_ERROR || outcome.code == CURLE_BAD_DOWNLOAD_RESUME ||
         outcome.status == 416;
}

}  // namespace

const char* redirect_protocols(const std::string& address) {
  return address.starts_with("https:") ? "https" : "http,https";
}

DownloadResult download(const std::string& address, const fs::path& part_path,
                        const DownloadOptions& options) {
  PartFile part(part_path);
  if (!options.resume) part.truncate();
  DownloadResult result{part.size() > 0};
  Outcome outcome = transfer_once(address, part, options);
  if (result.resumed && cannot_resume(outcome)) {
    part.truncate();
    result.resumed = false;
    outcome = transfer_once(address, part, options);
  }
  if (outcome.code == CURLE_ABORTED_BY_CALLBACK)
    throw Interrupted("interrupted; ", part_path.string(), " keeps ", part.size(), " bytes");
  if (outcome.write_error)
    throw Error(part_path.string(), ": cannot write: ", std::strerror(outcome.write_error));
  if (outcome.too_much) {
    part.truncate();
    throw DownloadError("the server sends more than ", options.most_bytes, " bytes");
  }
  if (outcome.code != CURLE_OK) throw DownloadError(outcome.reason);
  part.sync();
  return result;
}

}  // namespace revisit::models
