#include "models/fetch.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>
#include <zlib.h>

#include <cerrno>
#include <cstring>
#include <memory>
#include <vector>

#include "models/cache.h"
#include "models/checksum.h"
#include "revisit/base/files.h"
#include "revisit/proto/net_file.h"
#include "revisit/proto/weights_file.h"
#include "revisit/weights_conversion/trunks.h"

namespace revisit::models {
namespace {

namespace fs = std::filesystem;

std::string by_hand(const KnownModel& model, const fs::path& file) {
  return str("\n  address: ", model.address,
             "\n  to do it by hand: download it elsewhere, save it as ", file.string(),
             "\n  and check it with 'revisit models list'");
}

void make_folder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error)
    throw Error(folder.string(), ": cannot create the folder: ", error.message(),
                "; give another with --models DIR or REVISIT_MODELS");
}

/// Ends with the process at the latest.
class FolderLock {
 public:
  explicit FolderLock(const fs::path& folder)
      : descriptor_(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)) {
    if (descriptor_ >= 0 && ::flock(descriptor_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
      ::close(descriptor_);
      throw Error(folder.string(), ": another process is fetching this model; wait for it");
    }
  }
  ~FolderLock() {
    if (descriptor_ >= 0) ::close(descriptor_);
  }
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  int descriptor_;
};

/// Reads the whole archive, because its checksum is at its end.
void check_gzip(const fs::path& file) {
  const std::unique_ptr<gzFile_s, decltype(&gzclose)> in(gzopen(file.c_str(), "rb"), gzclose);
  if (!in) throw Error(file.string(), ": cannot read: ", std::strerror(errno));
  std::vector<char> block(size_t{1} << 20);
  int count = 0;
  do count = gzread(in.get(), block.data(), static_cast<unsigned>(block.size()));
  while (count > 0 && !gzdirect(in.get()));
  int error = Z_OK;
  const char* const reason = gzerror(in.get(), &error);
  if (gzdirect(in.get())) throw InputError("not a gzip archive");
  if (count < 0 || error != Z_OK) throw InputError("not a complete gzip archive: ", reason);
}

/// Rejects a web page instead of weights.
void check_plausible(const KnownModel& model, const fs::path& part, const std::string& sha1) {
  try {
    if (model.file.ends_with(".tar.gz")) {
      check_gzip(part);
    } else if (proto::WeightsFile::open(part)->layers().empty()) {
      throw InputError("no layers");
    }
  } catch (const InputError& error) {
    throw Error("what ", model.address, " gave is not the model (sha1 ", sha1, "): ", error.what(),
                "; it was removed");
  }
}

/// Returns the checksum. Throws Error if `part` is not the model.
std::string check(const KnownModel& model, const fs::path& part) {
  const std::string sha1 = file_sha1(part);
  if (model.sha1.empty() || (model.sha1_is_doubtful && model.sha1 != sha1)) {
    check_plausible(model, part, sha1);
  } else if (model.sha1 != sha1) {
    throw Error("the download of ", model.name, " is not the known file and was removed",
                "\n  sha1 expected: ", model.sha1, " (", model.sha1_source,
                ")\n  sha1 found:    ", sha1, "\n  address: ", model.address);
  }
  return sha1;
}

/// Returns the checksum. Fetches a resumed file with a wrong checksum again.
std::string download_checked(const KnownModel& model, const fs::path& part,
                             DownloadOptions options) {
  options.resume &= !model.sha1.empty();
  // A process killed between the last byte and the renaming leaves a complete file.
  if (options.resume && fs::exists(part) && file_sha1(part) == model.sha1) return model.sha1;
  const DownloadResult result = download(model.address, part, options);
  try {
    const std::string sha1 = check(model, part);
    // A resumed file may mix two versions, so only a whole download may have another checksum.
    if (!result.resumed || model.sha1.empty() || sha1 == model.sha1) return sha1;
  } catch (const Error&) {
    fs::remove(part);
    if (!result.resumed) throw;
  }
  options.resume = false;
  return download_checked(model, part, options);
}

fs::path put_trunk(const KnownModel& model, const fs::path& folder) {
  if (model.trunk.empty()) return {};
  const fs::path prototxt = folder / "deploy.prototxt";
  if (!fs::exists(prototxt)) proto::write_net_text(prototxt, trunk(model.trunk));
  return prototxt;
}

/// Returns the checksum.
std::string fetch_absent(const KnownModel& model, const fs::path& file,
                         const DownloadOptions& options) {
  const fs::path part = file.string() + ".part";
  try {
    const std::string sha1 = download_checked(model, part, options);
    rename_into_place(part, file);
    return sha1;
  } catch (const DownloadError& error) {
    std::error_code none;
    if (fs::is_empty(part, none)) fs::remove(part, none);
    throw Error("cannot fetch ", model.name, ": ", error.what(), by_hand(model, file));
  }
}

bool can_be_fetched(const KnownModel& model) {
  return !model.address.empty() && !model.needs_browser;
}

}  // namespace

std::string how_to_get(const KnownModel& model, const fs::path& cache) {
  const std::string file = cached_file(cache, model).string();
  if (can_be_fetched(model)) return str("'revisit models fetch ", model.name, "' gets it");
  if (model.address.empty())
    return str("no public address is known; if you have it, save it as ", file);
  return str("download it with a browser from ", model.address, " and save it as ", file);
}

Fetched fetch_model(const KnownModel& model, const fs::path& cache,
                    const DownloadOptions& options) {
  const fs::path file = cached_file(cache, model);
  if (can_be_fetched(model)) make_folder(file.parent_path());
  const FolderLock lock(file.parent_path());
  const CacheEntry entry = inspect(cache, model);
  Fetched fetched{entry.file, {}, entry.sha1, entry.state == CacheState::kVerified, true};
  switch (entry.state) {
    case CacheState::kVerified:
    case CacheState::kUnverified:
      break;
    case CacheState::kIncorrect:
      throw Error(entry.file.string(), ": not the known file; remove it and fetch again",
                  "\n  sha1 expected: ", model.sha1, " (", model.sha1_source,
                  ")\n  sha1 found:    ", entry.sha1);
    case CacheState::kAbsent:
    case CacheState::kPartial:
      if (model.address.empty())
        throw Error("no public address is known for ", model.name, "; if you have it, save it as ",
                    file.string());
      if (model.needs_browser)
        throw Error(model.name, ": only a browser can download it", by_hand(model, file));
      fetched.sha1 = fetch_absent(model, file, options);
      fetched.verified = fetched.sha1 == model.sha1;
      fetched.was_there = false;
  }
  fetched.prototxt = put_trunk(model, file.parent_path());
  return fetched;
}

}  // namespace revisit::models
