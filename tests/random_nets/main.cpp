// Runs random nets for a given time:
//   revisit_random_nets [--minutes M] [--first-seed N] [--nets K] [--keep-going] [--save FOLDER]
// Prints a fault with its seed and exits with 1; --keep-going collects faults.
// Repeats one seed with --first-seed N --nets 1.
// --save writes FOLDER/SEED/ for another program (onnx_oracle.py, see save()) and compares nothing.
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <iostream>
#include <limits>

#include "check.h"

namespace revisit::random_nets {
namespace {

struct Request {
  double minutes = 1;
  uint64_t first_seed = 1'000'000, nets = std::numeric_limits<uint64_t>::max();
  bool keep_going = false;
  std::filesystem::path save;
};

Request parse(int argc, char** argv) {
  Request request;
  for (int i = 1; i < argc; ++i) {
    const std::string option = argv[i];
    if (option == "--keep-going") {
      request.keep_going = true;
      continue;
    }
    if (i + 1 == argc) throw std::invalid_argument(option + " needs a value");
    const std::string value = argv[++i];
    if (option == "--minutes")
      request.minutes = std::stod(value);
    else if (option == "--first-seed")
      request.first_seed = std::stoull(value);
    else if (option == "--nets")
      request.nets = std::stoull(value);
    else if (option == "--save")
      request.save = value;
    else
      throw std::invalid_argument("unknown option " + option);
  }
  return request;
}

std::atomic<uint64_t> current_seed;

/// Prints the seed that crashed; then the signal takes its default action.
void say_seed(int signal) {
  char text[64];
  const int length = std::snprintf(text, sizeof(text), "CRASH seed %llu, signal %d\n",
                                   static_cast<unsigned long long>(current_seed), signal);
  if (::write(STDERR_FILENO, text, static_cast<size_t>(length)) < 0) ::_exit(signal);
  std::signal(signal, SIG_DFL);
  std::raise(signal);
}

void print(const Statistics& s, uint64_t next_seed, int faults) {
  std::cout << s.nets << " nets (" << s.too_large << " with NaN or values near infinity, "
            << s.other_shapes << " with two shapes, " << s.gray << " gray, " << s.truncated
            << " cut off), " << s.outputs << " outputs compared, " << s.insensitive
            << " of them insensitive, " << faults << " faults, next seed " << next_seed << ", "
            << std::clock() / CLOCKS_PER_SEC << " s of CPU" << std::endl;
}

int run(const Request& request) {
  using Clock = std::chrono::steady_clock;
  const auto begin = Clock::now();
  auto said = begin;
  const auto minutes_since = [](Clock::time_point time) {
    return std::chrono::duration<double>(Clock::now() - time).count() / 60;
  };
  Statistics statistics;
  int faults = 0;
  uint64_t seed = request.first_seed;
  for (; seed - request.first_seed < request.nets && minutes_since(begin) < request.minutes;
       ++seed) {
    current_seed = seed;
    if (!request.save.empty()) {
      save(seed, request.save / std::to_string(seed));
      continue;
    }
    const std::string fault = find_fault(seed, statistics);
    if (!fault.empty()) {
      ++faults;
      std::cout << "FAULT " << fault << std::endl;
      if (!request.keep_going) break;
    }
    if (minutes_since(said) > 1) {
      print(statistics, seed + 1, faults);
      said = Clock::now();
    }
  }
  if (request.save.empty()) print(statistics, seed, faults);
  return faults > 0 ? 1 : 0;
}

}  // namespace
}  // namespace revisit::random_nets

int main(int argc, char** argv) {
  for (const int signal : {SIGSEGV, SIGBUS, SIGFPE, SIGABRT})
    std::signal(signal, revisit::random_nets::say_seed);
  try {
    return revisit::random_nets::run(revisit::random_nets::parse(argc, argv));
  } catch (const std::exception& error) {
    std::cerr << "revisit_random_nets: " << error.what() << '\n';
    return 2;
  }
}
