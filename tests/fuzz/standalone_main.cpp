// Runs a fuzz target without libFuzzer on given cases and on mutated seeds, deterministic in
// --seed. A finding (crash, sanitizer report, other exception, 10 s, 1 GB) ends the program, which
// saves the case in a file.
//
//   fuzz_NAME [FILE|DIR...] [--seeds DIR[/PATTERN]]... [--runs N] [--seconds T] [--seed S]
//             [--artifacts DIR]
#include <fcntl.h>
#include <fnmatch.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <csignal>
#include <cstring>
#include <fstream>
#include <iostream>
#include <iterator>
#include <vector>

#include "fuzz.h"
#include "mutator.h"

#if defined(__SANITIZE_ADDRESS__)
extern "C" void __sanitizer_set_death_callback(void (*callback)());
extern "C" const char* __asan_default_options() {
  return "max_allocation_size_mb=512:hard_rss_limit_mb=1024:handle_abort=1";
}
#endif

namespace revisit::fuzz {
namespace {

namespace fs = std::filesystem;

constexpr size_t kMaxCase = 64 * 1024;  // [bytes]
constexpr unsigned kMaxTime = 10;       // [s] of one case

struct Options {
  std::vector<std::string> cases, seeds;
  uint64_t runs = 0, seconds = 0, seed = 1;
  std::string artifacts = ".";
};

/// Data for save_case(), because a signal handler may only read it.
struct {
  const std::string* bytes = nullptr;
  char file[4096] = "";
} current;

void say(const char* text) {
  if (::write(STDERR_FILENO, text, std::strlen(text)) < 0) std::_Exit(1);
}

void save_case() {
  if (!current.bytes) return;
  const int file = ::open(current.file, O_WRONLY | O_CREAT | O_TRUNC, 0666);
  const bool saved = ::write(file, current.bytes->data(), current.bytes->size()) >= 0;
  ::close(file);
  say(saved ? "\nFINDING: run this program with the case: " : "\nFINDING, cannot be saved: ");
  say(current.file);
  say("\n");
  current.bytes = nullptr;
}

void on_signal(int signal) {
  if (signal == SIGALRM) say("\na case takes longer than 10 s\n");
  save_case();
  std::signal(signal, SIG_DFL);
  ::raise(signal);
}

void watch() {
#if defined(__SANITIZE_ADDRESS__)
  __sanitizer_set_death_callback(save_case);
#else
  for (const int signal : {SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGTRAP})
    std::signal(signal, on_signal);
  // A limit of 1 GB more than now lets a runaway allocation throw std::bad_alloc.
  uint64_t pages = 0;
  std::ifstream("/proc/self/statm") >> pages;
  rlimit limit{};
  ::getrlimit(RLIMIT_AS, &limit);
  limit.rlim_cur = pages * static_cast<uint64_t>(::sysconf(_SC_PAGESIZE)) + (1U << 30);
  ::setrlimit(RLIMIT_AS, &limit);
#endif
  std::signal(SIGALRM, on_signal);
}

void run(const std::string& bytes, const Options& options, const std::string& name) {
  std::snprintf(current.file, sizeof current.file, "%s/finding-%s", options.artifacts.c_str(),
                name.c_str());
  current.bytes = &bytes;
  ::alarm(kMaxTime);
  // Exactly as long as the case, so that sanitizers detect reads beyond it.
  const std::vector<uint8_t> copy(bytes.begin(), bytes.end());
  LLVMFuzzerTestOneInput(copy.data(), copy.size());
  ::alarm(0);
  current.bytes = nullptr;
}

std::string content_of(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// Returns files in a fixed order: below a folder, the file itself, or matches of DIR/PATTERN.
std::vector<fs::path> files_of(fs::path place) {
  std::string pattern = "*";
  if (place.filename().string().find('*') != std::string::npos) {
    pattern = place.filename().string();
    place = place.parent_path();
  }
  if (fs::is_regular_file(place)) return {place};
  std::vector<fs::path> files;
  if (!fs::is_directory(place)) return files;
  for (const auto& entry : fs::recursive_directory_iterator(place))
    if (entry.is_regular_file() &&
        ::fnmatch(pattern.c_str(), entry.path().filename().c_str(), FNM_PERIOD) == 0)
      files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  return files;
}

Options parse(const std::vector<std::string>& arguments) {
  Options options;
  for (size_t i = 0; i < arguments.size(); ++i) {
    const std::string& name = arguments[i];
    if (!name.starts_with("--")) {
      options.cases.push_back(name);
      continue;
    }
    if (++i == arguments.size()) throw UsageError(name + ": needs a value");
    const std::string& value = arguments[i];
    const auto number = [&] {
      uint64_t result = 0;
      const char* const end = value.data() + value.size();
      if (std::from_chars(value.data(), end, result).ptr != end)
        throw UsageError(name + ": not a number: " + value);
      return result;
    };
    if (name == "--seeds")
      options.seeds.push_back(value);
    else if (name == "--runs")
      options.runs = number();
    else if (name == "--seconds")
      options.seconds = number();
    else if (name == "--seed")
      options.seed = number();
    else if (name == "--artifacts")
      options.artifacts = value;
    else
      throw UsageError(name + ": no such option");
  }
  return options;
}

uint64_t run_mutants(const Options& options) {
  std::vector<std::string> seeds;
  for (const std::string& place : options.seeds)
    for (const fs::path& file : files_of(place))
      seeds.push_back(content_of(file).substr(0, kMaxCase));
  if (seeds.empty()) throw UsageError("--seeds: no files there");

  using Clock = std::chrono::steady_clock;
  const Clock::time_point end = Clock::now() + std::chrono::seconds(options.seconds);
  const auto goes_on = [&](uint64_t done) {
    return options.seconds > 0 ? Clock::now() < end : done < options.runs;
  };
  uint64_t done = 0;
  for (; goes_on(done); ++done) {
    Random random(options.seed * 0x9E3779B97F4A7C15ULL ^ done);  // independent of other cases
    std::string bytes = seeds[random.below(seeds.size())];
    mutate(bytes, seeds[random.below(seeds.size())], kMaxCase, random);
    run(bytes, options, str("seed", options.seed, "-run", done));
  }
  return done;
}

int main_of(const std::vector<std::string>& arguments) {
  const Options options = parse(arguments);
  watch();
  uint64_t given = 0;
  for (const std::string& place : options.cases)
    for (const fs::path& file : files_of(place)) {
      run(content_of(file), options, file.filename().string());
      ++given;
    }
  const uint64_t given_successes = successes;
  const uint64_t made = options.seeds.empty() ? 0 : run_mutants(options);
  std::cout << given << " given cases and " << made << " made ones (" << rejections
            << " rejections): no findings\n";
  if (made == 0 || successes > given_successes || rejections == 0) return 0;
  std::cerr << "each was refused: the seeds are of no format that is read\n";
  return 1;
}

}  // namespace
}  // namespace revisit::fuzz

int main(int argc, char** argv) {
  try {
    return revisit::fuzz::main_of({argv + 1, argv + argc});
  } catch (const revisit::UsageError& error) {
    std::cerr << error.what() << "\n";
    return 2;
  }
}
