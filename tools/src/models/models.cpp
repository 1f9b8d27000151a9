#include "models/models.h"

#include <openssl/evp.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <iterator>
#include <mutex>
#include <sstream>

#include "cli/shell.h"
#include "cli/terminal.h"
#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/proto/weights_file.h"

namespace revisit::models {
namespace {

namespace fs = std::filesystem;

std::string read_and_sum(const fs::path& file) {
  const std::string content = read_content(file);
  unsigned char sum[EVP_MAX_MD_SIZE];
  size_t length = 0;
  if (EVP_Q_digest(nullptr, "SHA1", nullptr, content.data(), content.size(), sum, &length) != 1)
    throw Error("OpenSSL does not support SHA-1 on this system");
  std::string text;
  for (size_t i = 0; i < length; ++i) {
    text += "0123456789abcdef"[sum[i] >> 4];
    text += "0123456789abcdef"[sum[i] & 15];
  }
  return text;
}

/// Changes with the content; "" if the file cannot be examined.
std::string state_of(const fs::path& file) {
  struct stat s {};
  if (::stat(file.c_str(), &s) != 0) return "";
  return str(fs::absolute(file).string(), " ", s.st_dev, " ", s.st_ino, " ", s.st_size, " ",
             s.st_mtim.tv_sec, ".", s.st_mtim.tv_nsec, " ", s.st_ctim.tv_sec, ".",
             s.st_ctim.tv_nsec);
}

fs::path environment_path(const char* name) {
  const char* const value = std::getenv(name);
  return value ? fs::path(value) : fs::path();
}

fs::path cached_file(const fs::path& cache, const KnownModel& model) {
  return cache / model.name / model.file;
}

bool ends_with_one_of(const std::string& name, std::initializer_list<const char*> endings) {
  return std::ranges::any_of(endings, [&](const char* ending) { return name.ends_with(ending); });
}

template <class Iterator>
std::vector<fs::path> files_of(const fs::path& folder, std::initializer_list<const char*> endings) {
  std::vector<fs::path> files;
  std::error_code error;
  for (Iterator entry(folder, error), end; !error && entry != end; entry.increment(error))
    if (entry->is_regular_file(error) &&
        ends_with_one_of(entry->path().filename().string(), endings))
      files.push_back(entry->path());
  std::ranges::sort(files);
  return files;
}

/// Continues `part`. Returns curl's exit code; curl prints the reason of a failure.
int run_curl(const std::string& address, const fs::path& part) {
  constexpr const char* kOptions =
      "curl --fail --location --connect-timeout 20 --speed-limit 1000 --speed-time 60 "
      "--max-filesize 1073741824 --proto =http,https,file --proto-redir =https --continue-at -";
  std::istringstream words(kOptions);
  std::vector<std::string> command{std::istream_iterator<std::string>(words), {}};
  // A redirect leads to no local file, and from https only to https.
  if (!address.starts_with("https:"))
    command.insert(command.end(), {"--proto-redir", "=http,https"});
  if (!::isatty(STDERR_FILENO)) command.insert(command.end(), {"--silent", "--show-error"});
  command.insert(command.end(), {"--output", part.string(), "--url", address});
  const int code = cli::run_program(command, "curl");
  if (cli::interrupted()) throw Interrupted("interrupted; ", part.string(), " keeps what arrived");
  return code;
}

/// Exit codes of curl if the server ignores ranges, or has no more bytes than the part.
bool cannot_resume(int code) {
  constexpr int kHttpError = 22, kRangeError = 33, kBadResume = 36;
  return code == kHttpError || code == kRangeError || code == kBadResume;
}

void download(const KnownModel& model, const fs::path& file, const fs::path& part) {
  if (fs::is_symlink(part))
    throw Error(part.string(), ": the download does not follow a symbolic link; remove it");
  // Without a checksum, a continued download could mix two versions.
  if (model.sha1.empty()) fs::remove(part);
  const bool resumes = fs::exists(part);
  // A process killed between the last byte and the renaming leaves a complete file.
  if (resumes && file_sha1(part) == model.sha1) return;
  int code = run_curl(model.address, part);
  if (resumes && (code == 0 ? file_sha1(part) != model.sha1 : cannot_resume(code))) {
    fs::remove(part);
    code = run_curl(model.address, part);
  }
  if (code != 0)
    throw Error("cannot fetch ", model.name, ": curl failed with exit code ", code,
                "\n  address: ", model.address,
                "\n  to do it by hand: download it elsewhere, save it as ", file.string(),
                "\n  and check it with 'revisit models list'");
}

/// Throws InputError for a web page instead of weights.
void check_plausible(const KnownModel& model, const fs::path& part) {
  constexpr std::string_view kGzipMagic = "\x1f\x8b\x08";
  if (model.file.ends_with(".tar.gz")) {
    if (read_head(part, kGzipMagic.size()) != kGzipMagic) throw InputError("not a gzip archive");
  } else if (proto::WeightsFile::open(part)->layers().empty()) {
    throw InputError("no layers");
  }
}

/// Returns the checksum. Throws Error if the part is not the model.
std::string check(const KnownModel& model, const fs::path& part) {
  std::string sha1 = file_sha1(part);
  if (sha1 == model.sha1) return sha1;
  if (!model.sha1.empty() && !model.sha1_is_doubtful)
    throw Error("the download of ", model.name, " is not the known file and was removed",
                "\n  sha1 expected: ", model.sha1, " (", model.sha1_source,
                ")\n  sha1 found:    ", sha1, "\n  address: ", model.address);
  try {
    check_plausible(model, part);
  } catch (const InputError& error) {
    throw Error("what ", model.address, " gave is not the model (sha1 ", sha1, "): ", error.what(),
                "; it was removed");
  }
  return sha1;
}

/// Returns the checksum.
std::string fetch_absent(const KnownModel& model, const fs::path& file) {
  const fs::path part = file.string() + ".part";
  make_folder(file.parent_path());
  download(model, file, part);
  std::string sha1;
  try {
    sha1 = check(model, part);
  } catch (const Error&) {
    fs::remove(part);
    throw;
  }
  rename_into_place(part, file);
  return sha1;
}

bool can_be_fetched(const KnownModel& model) {
  return !model.address.empty() && !model.needs_browser;
}

}  // namespace

std::string file_sha1(const fs::path& file) {
  static std::mutex mutex;
  static std::map<std::string, std::string> known;
  const std::string state = state_of(file);
  {
    const std::scoped_lock lock(mutex);
    if (const auto found = known.find(state); found != known.end()) return found->second;
  }
  const std::string sum = read_and_sum(file);
  const std::scoped_lock lock(mutex);
  if (state == state_of(file)) known[state] = sum;
  return sum;
}

fs::path cache_folder() {
  if (const fs::path models = environment_path("REVISIT_MODELS"); !models.empty()) return models;
  // The XDG specification requires to ignore a relative path.
  if (const fs::path xdg = environment_path("XDG_CACHE_HOME"); xdg.is_absolute())
    return xdg / "revisit" / "models";
  if (const fs::path home = environment_path("HOME"); !home.empty())
    return home / ".cache" / "revisit" / "models";
  throw UsageError("no folder for models, because HOME is not set; set REVISIT_MODELS");
}

const char* to_string(CacheState state) {
  constexpr const char* kNames[] = {"absent", "partial", "unverified", "verified",
                                    "wrong checksum"};  // in the order of the enumeration
  return kNames[static_cast<size_t>(state)];
}

std::vector<fs::path> files_in(const fs::path& folder, std::initializer_list<const char*> endings,
                               bool below) {
  return below ? files_of<fs::recursive_directory_iterator>(folder, endings)
               : files_of<fs::directory_iterator>(folder, endings);
}

std::optional<fs::path> cached_weights(const fs::path& cache, const KnownModel& model) {
  std::error_code none;
  if (const fs::path file = cached_file(cache, model);
      ends_with_one_of(model.file, kWeights) && fs::is_regular_file(file, none))
    return file;
  const std::vector<fs::path> all = files_in(cache / model.name, kWeights);
  return all.size() == 1 ? std::optional(all[0]) : std::nullopt;
}

std::map<std::string, fs::path> loose_weights(const fs::path& cache) {
  std::map<std::string, fs::path> loose;
  for (const fs::path& file : files_in(cache, kWeights)) loose.emplace(file_sha1(file), file);
  return loose;
}

CacheEntry inspect(const fs::path& cache, const KnownModel& model,
                   const std::map<std::string, fs::path>& loose) {
  CacheEntry entry;
  entry.file = cached_file(cache, model);
  std::error_code none;
  const auto found = loose.find(model.sha1);
  if (const auto weights = cached_weights(cache, model); weights)
    entry.file = *weights;
  else if (!fs::is_regular_file(entry.file, none) && found != loose.end())
    entry.file = found->second;
  if (fs::is_regular_file(entry.file, none)) {
    entry.size = fs::file_size(entry.file);
    entry.sha1 = file_sha1(entry.file);
    entry.state = !model.sha1.empty() && model.sha1 == entry.sha1 ? CacheState::kVerified
                  : model.sha1.empty() || model.sha1_is_doubtful  ? CacheState::kUnverified
                                                                  : CacheState::kIncorrect;
  } else if (const fs::path part = entry.file.string() + ".part"; fs::exists(part, none)) {
    entry.size = fs::file_size(part, none);
    entry.state = CacheState::kPartial;
  }
  return entry;
}

std::string how_to_get(const KnownModel& model, const fs::path& cache) {
  const std::string file = cached_file(cache, model).string();
  if (can_be_fetched(model)) return str("'revisit models fetch ", model.name, "' gets it");
  if (model.address.empty())
    return str("no public address is known; if you have it, save it as ", file);
  return str("download it with a browser from ", model.address, " and save it as ", file);
}

Fetched fetch_model(const KnownModel& model, const fs::path& cache) {
  const fs::path file = cached_file(cache, model);
  const CacheEntry entry = inspect(cache, model);
  Fetched fetched{entry.file, {}, entry.sha1, entry.state == CacheState::kVerified, true};
  if (entry.state == CacheState::kIncorrect)
    throw Error(entry.file.string(), ": not the known file; remove it and fetch again",
                "\n  sha1 expected: ", model.sha1, " (", model.sha1_source,
                ")\n  sha1 found:    ", entry.sha1);
  if (entry.state == CacheState::kAbsent || entry.state == CacheState::kPartial) {
    if (!can_be_fetched(model)) throw Error(model.name, ": ", how_to_get(model, cache));
    fetched.sha1 = fetch_absent(model, file);
    fetched.verified = fetched.sha1 == model.sha1;
    fetched.was_there = false;
  }
  fetched.prototxt = own_prototxt(model, cache);
  return fetched;
}

fs::path own_prototxt(const KnownModel& model, const fs::path& cache) {
  const char* const net = own_net(model.own_net);
  if (!net) return {};
  const fs::path prototxt = cached_file(cache, model).parent_path() / "deploy.prototxt";
  if (fs::exists(prototxt)) return prototxt;
  make_folder(prototxt.parent_path());
  write_atomically(prototxt, [&](std::ostream& out) { out << net; });
  return prototxt;
}

}  // namespace revisit::models
