#include "models/fetch.h"

#include <unistd.h>

#include <iterator>
#include <sstream>

#include "cli/shell.h"
#include "cli/terminal.h"
#include "models/cache.h"
#include "revisit/base/files.h"
#include "revisit/proto/weights_file.h"

namespace revisit::models {
namespace {

namespace fs = std::filesystem;

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
