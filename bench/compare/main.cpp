// Runs one net through several engines in turn, on the same input. Prints times, and differences
// from the first engine's output, as JSON.
//   revisit_compare net.prototxt net.caffemodel [ENGINE...] [--threads N] [--repeat R] [--gray]
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <numeric>
#include <thread>

#include "revisit/engine/machine.h"
#include "subject.h"

namespace revisit::bench {

double now_ms() {
  using Clock = std::chrono::steady_clock;
  return std::chrono::duration<double, std::milli>(Clock::now().time_since_epoch()).count();
}

}  // namespace revisit::bench

namespace {

using namespace revisit;
using namespace revisit::bench;

using Engine = std::pair<std::string, MakeSubject>;

std::vector<Engine> engines() {
  return {
      {"revisit", make_ours},
      {"original", make_original},
#ifdef REVISIT_HAVE_ONEDNN
      {"onednn", make_onednn},
#endif
#ifdef REVISIT_HAVE_OPENCV
      {"opencv", make_opencv},
#endif
  };
}

struct Options {
  std::string prototxt, weights;
  Setting setting;
  int repeat = 20;
  std::vector<std::string> engines = {};
};

Options parse(int argc, char** argv) {
  Options options;
  std::vector<std::string> words;
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    const auto value = [&] {
      if (i + 1 == argc) throw UsageError(str(argument, ": missing value"));
      return std::string(argv[++i]);
    };
    if (argument == "--threads")
      options.setting.threads = std::stoi(value());
    else if (argument == "--repeat")
      options.repeat = std::stoi(value());
    else if (argument == "--gray")
      options.setting.gray = true;
    else if (argument.starts_with("--"))
      throw UsageError(str("unknown option ", argument));
    else
      words.push_back(argument);
  }
  if (words.size() < 2)
    throw UsageError(
        "usage: revisit_compare PROTOTXT WEIGHTS [ENGINE...] [--threads N] [--repeat R] [--gray]");
  options.prototxt = words[0], options.weights = words[1];
  options.engines.assign(words.begin() + 2, words.end());
  if (options.engines.empty())
    for (const Engine& engine : engines()) options.engines.push_back(engine.first);
  return options;
}

/// OpenBLAS 0.3.21 chooses slow kernels on a CPU newer than itself. The variable that selects
/// better ones must be set before it is loaded.
void restart_with_best_blas(char** argv) {
  const std::string core = engine::faster_blas_core();
  if (core.empty() || std::getenv("OPENBLAS_CORETYPE")) return;
  setenv("OPENBLAS_CORETYPE", core.c_str(), 1);
  execv("/proc/self/exe", argv);
}

/// Returns values of zero mean, equal in every channel.
std::vector<float> equal_channels(const engine::Shape& shape) {
  const int64_t pixels = shape[2] * shape[3];
  std::vector<float> values(shape.elements());
  for (size_t i = 0; i < values.size(); ++i) {
    const auto at =
        static_cast<int64_t>(i) % pixels + static_cast<int64_t>(i) / (shape[1] * pixels);
    values[i] = std::sin(0.37F * static_cast<float>(at % 9973));
  }
  return values;
}

struct Difference {
  double max = 0, rms = 0;  // relative to the largest, to the rms, of the wanted values
};

Difference difference(std::span<const float> found, std::span<const float> wanted) {
  if (found.size() != wanted.size()) throw Error("outputs differ in size");
  double max = 0, largest = 0, squares = 0, wanted_squares = 0;
  for (size_t i = 0; i < wanted.size(); ++i) {
    const double d = static_cast<double>(found[i]) - wanted[i], w = wanted[i];
    max = std::max(max, std::isnan(d) ? INFINITY : std::abs(d));
    largest = std::max(largest, std::abs(w));
    squares += d * d;
    wanted_squares += w * w;
  }
  return {max / largest, std::sqrt(squares / wanted_squares)};
}

double cpu_ms() {
  timespec time{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) * 1e3 + static_cast<double>(time.tv_nsec) * 1e-6;
}

struct Measured {
  std::string key;
  std::unique_ptr<Subject> subject;
  std::vector<double> samples_ms = {};  // full passes
  /// CPU time of the process, for one thread: other programs affect it less than the clock.
  double min_cpu_ms = std::numeric_limits<double>::infinity();
  std::vector<double> steps = {};  // minimum of each [ms]

  void run() {
    const double start = now_ms(), cpu_start = cpu_ms();
    subject->forward();
    samples_ms.push_back(now_ms() - start);
    min_cpu_ms = std::min(min_cpu_ms, cpu_ms() - cpu_start);
  }
  void run_steps() {
    const std::vector<double> times = subject->timed_forward();
    if (steps.empty()) steps = times;
    for (size_t i = 0; i < steps.size(); ++i) steps[i] = std::min(steps[i], times[i]);
  }
  /// Time of a pass on an otherwise idle machine, nearly.
  double steps_ms() const { return std::accumulate(steps.begin(), steps.end(), 0.0); }
};

/// Engines run in turn, so that drift of the machine affects all alike. Pauses let the threads of
/// one engine sleep before the next begins.
void measure(std::vector<Measured>& all, int repeat) {
  constexpr auto kPause = std::chrono::milliseconds(20);
  for (Measured& m : all) m.subject->forward();  // one-time work
  for (int i = 0; i < repeat; ++i)
    for (Measured& m : all) {
      std::this_thread::sleep_for(kPause);
      m.run();
      std::this_thread::sleep_for(kPause);
      m.run_steps();
    }
}

void print(const Options& options, const Model& model, std::vector<Measured>& all) {
  std::printf("{\"prototxt\": \"%s\", \"input\": [", options.prototxt.c_str());
  for (size_t i = 0; i < model.input().rank(); ++i)
    std::printf("%s%lld", i ? ", " : "", static_cast<long long>(model.input()[i]));
  std::printf(
      "], \"threads\": %d, \"gray\": %s, \"repeat\": %d, \"blas\": \"%s\",\n \"engines\": [",
      options.setting.threads, options.setting.gray ? "true" : "false", options.repeat,
      engine::blas_core().c_str());
  for (size_t i = 0; i < all.size(); ++i) {
    std::sort(all[i].samples_ms.begin(), all[i].samples_ms.end());
    const Difference d = difference(all[i].subject->output(), all[0].subject->output());
    std::printf(
        "%s\n    {\"engine\": \"%s\", \"name\": \"%s\", \"min_ms\": %.4f, \"median_ms\": %.4f, "
        "\"cpu_ms\": %.4f, \"steps_ms\": %.4f, \"max_difference\": %.3g, \"rms_difference\": %.3g}",
        i ? "," : "", all[i].key.c_str(), all[i].subject->name().c_str(), all[i].samples_ms.front(),
        all[i].samples_ms[all[i].samples_ms.size() / 2], all[i].min_cpu_ms, all[i].steps_ms(),
        d.max, d.rms);
  }
  std::printf("]}\n");
}

}  // namespace

int main(int argc, char** argv) try {
  const Options options = parse(argc, argv);
  restart_with_best_blas(argv);
  const Model model = read_model(options.prototxt, options.weights);
  const std::vector<float> input = equal_channels(model.input());
  std::vector<Measured> all;
  for (const std::string& name : options.engines) {
    const std::vector<Engine> known = engines();
    const auto found = std::find_if(known.begin(), known.end(),
                                    [&](const Engine& engine) { return engine.first == name; });
    if (found == known.end()) throw UsageError(str("no engine '", name, "' in this build"));
    all.push_back({name, found->second(model, options.setting, input)});
  }
  measure(all, options.repeat);
  print(options, model, all);
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "revisit_compare: %s\n", error.what());
  return 1;
}
