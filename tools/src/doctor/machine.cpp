#include "revisit/engine/machine.h"

#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <thread>

#include "doctor/checks.h"
#include "revisit/base/error.h"

// Declared in OpenBLAS' cblas.h, which only the engine includes.
extern "C" char* openblas_get_config(void);

namespace revisit::doctor {
namespace {

namespace fs = std::filesystem;

constexpr double kGigabyte = 1e9;

std::string gigabytes(double bytes) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f GB", bytes / kGigabyte);
  return text;
}

/// Value of a line "key : value", or "".
std::string value_in(const char* file, const std::string& key) {
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    const size_t colon = line.find(':');
    if (colon == std::string::npos || !line.starts_with(key)) continue;
    const size_t begin = line.find_first_not_of(" \t", colon + 1);
    return begin == std::string::npos ? "" : line.substr(begin);
  }
  return "";
}

std::string cpu_features() {
#if defined(__x86_64__)
  __builtin_cpu_init();
  std::string text;
  const auto add = [&text](bool has, const char* name) {
    if (has) text += (text.empty() ? "" : " ") + std::string(name);
  };
  add(__builtin_cpu_supports("sse4.2"), "SSE4.2");
  add(__builtin_cpu_supports("avx2"), "AVX2");
  add(__builtin_cpu_supports("fma"), "FMA");
  add(__builtin_cpu_supports("avx512f"), "AVX-512F");
  add(__builtin_cpu_supports("avx512vnni"), "AVX512_VNNI");
  add(__builtin_cpu_supports("avx512bf16"), "AVX512_BF16");
  return text.empty() ? "SSE2 only" : text;
#elif defined(__aarch64__)
  return "NEON";
#else
  return "not examined on this architecture";
#endif
}

bool has_wide_vectors() {
#if defined(__x86_64__)
  return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
#else
  return true;
#endif
}

void check_cpu(Checks& checks) {
  const std::string model = value_in("/proc/cpuinfo", "model name");
  checks.push_back({"machine", "CPU", Status::kOk, model.empty() ? "unknown model" : model});
  const bool wide = has_wide_vectors();
  checks.push_back({"machine", "SIMD", wide ? Status::kOk : Status::kWarn,
                    cpu_features() + "; kernels use " + engine::simd_target(),
                    wide ? "" : "networks run several times slower than with AVX2"});
  const unsigned logical = std::thread::hardware_concurrency();
  const char* const omp = std::getenv("OMP_NUM_THREADS");
  checks.push_back(
      {"machine", "threads", Status::kOk,
       str(logical, " logical processors", omp ? str(", OMP_NUM_THREADS=", omp) : "")});
}

void check_blas(Checks& checks) {
  std::string configuration = openblas_get_config();
  while (configuration.ends_with(' ')) configuration.pop_back();
  const char* const forced = std::getenv("OPENBLAS_CORETYPE");  // by the user, or by main.cpp
  Check check{"machine", "OpenBLAS", Status::kOk,
              str("kernels for ", engine::blas_core(),
                  forced ? str(", by OPENBLAS_CORETYPE=", forced) : "", " (", configuration, ")")};
  if (const std::string faster = engine::faster_blas_core(); !faster.empty()) {
    check.status = Status::kWarn;
    check.advice =
        str("this CPU supports the kernels for ", faster, ", which are several times faster; ",
            forced ? "unset OPENBLAS_CORETYPE" : "export OPENBLAS_CORETYPE=" + faster);
  }
  checks.push_back(check);
  if (const char* size = std::getenv("OPENBLAS_L2_SIZE"))
    checks.push_back({"machine", "OPENBLAS_L2_SIZE", Status::kWarn, str("set to '", size, "'"),
                      "unset it, because it overrides the cache size that OpenBLAS detects"});
}

void check_memory(Checks& checks) {
  const std::string available = value_in("/proc/meminfo", "MemAvailable");  // "123 kB"
  if (available.empty()) {
    checks.push_back({"machine", "memory", Status::kWarn, "unknown"});
    return;
  }
  const double bytes = std::strtod(available.c_str(), nullptr) * 1024;
  const bool enough = bytes > 2 * kGigabyte;
  checks.push_back({"machine", "memory", enough ? Status::kOk : Status::kWarn,
                    gigabytes(bytes) + " available",
                    enough ? ""
                           : "a long drive may need more; close other programs, or use a "
                             "smaller feature layer"});
}

void check_disk(Checks& checks) {
  std::error_code error;
  const fs::space_info space = fs::space(fs::current_path(error), error);
  if (error) {
    checks.push_back({"machine", "disk", Status::kWarn, "unknown: " + error.message()});
    return;
  }
  const bool enough = static_cast<double>(space.available) > 2 * kGigabyte;
  checks.push_back({"machine", "disk", enough ? Status::kOk : Status::kWarn,
                    gigabytes(static_cast<double>(space.available)) + " free here",
                    enough ? "" : "features of a long drive may need more; free some space"});
}

void check_terminal(Checks& checks) {
  const char* const term = std::getenv("TERM");
  std::string found =
      str(isatty(STDERR_FILENO) ? "progress is shown" : "not a terminal: no progress line",
          term ? str(", TERM=", term) : "");
  if (std::getenv("NO_COLOR")) found += ", NO_COLOR set";
  checks.push_back({"machine", "terminal", Status::kOk, found});
}

}  // namespace

void check_machine(Checks& checks) {
  check_cpu(checks);
  check_blas(checks);
  check_memory(checks);
  check_disk(checks);
  check_terminal(checks);
}

}  // namespace revisit::doctor
