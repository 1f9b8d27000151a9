#include "loops/recording.h"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <set>

#include "cli/shell.h"
#include "revisit/base/error.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// "" is not among the paths that `-c` searches, because anyone may own the working directory.
constexpr const char* kLoops =
    "import sys; sys.path[:] = filter(None, sys.path); from revisit.program import loops; "
    "sys.exit(loops())";
/// Exits with 0 if the package is installed. Does not import it.
constexpr const char* kProbe =
    "import sys; sys.path[:] = filter(None, sys.path); from importlib.util import find_spec; "
    "from pathlib import Path; spec = find_spec('revisit'); "
    "sys.exit(not (spec and spec.origin and Path(spec.origin).with_name('program.py').is_file()))";

bool is_bag(const fs::path& file) {
  constexpr std::array kEndings = {".bag", ".db3", ".mcap"};
  return std::ranges::find(kEndings, file.extension().string()) != kEndings.end();
}

bool is_recording(const fs::path& data) {
  std::error_code error;
  if (fs::is_regular_file(data, error))
    return is_bag(data) || data.extension() == ".pcap" || data.extension() == ".osf";
  if (!fs::is_directory(data, error)) return false;
  if (fs::exists(data / "metadata.yaml", error)) return true;
  for (const fs::directory_entry& entry : fs::directory_iterator(data, error))
    if (is_bag(entry.path())) return true;
  return false;
}

bool has_package(const std::string& python) {
  std::array<std::string, 3> words = {python, "-c", kProbe};
  std::array<char*, 4> argv = {words[0].data(), words[1].data(), words[2].data(), nullptr};
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
    posix_spawn_file_actions_addopen(&actions, stream, "/dev/null", O_RDWR, 0);
  pid_t child = 0;
  const int error = posix_spawnp(&child, python.c_str(), &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  if (error != 0) return false;
  int status = 0;
  while (::waitpid(child, &status, 0) < 0)
    if (errno != EINTR) return false;
  return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

/// Returns errno, only if the program cannot be started.
int become(Arguments words) {
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  std::cout.flush();
  std::cerr.flush();
  ::execvp(argv[0], argv.data());
  return errno;
}

void become_python(const std::string& python, const Arguments& arguments) {
  Arguments words = {python, "-c", kLoops};
  words.insert(words.end(), arguments.begin(), arguments.end());
  become(std::move(words));
}

}  // namespace

fs::path recording_in(const Arguments& arguments, const std::vector<Row>& rows) {
  std::set<std::string> with_value;
  for (const Row& row : rows) {
    if (row.is_argument || row.is_flag()) continue;
    with_value.insert(row.spelled());
    if (row.letter) with_value.insert(std::string("-") + row.letter);
  }
  for (size_t i = 0; i < arguments.size(); ++i) {
    if (with_value.contains(arguments[i]))
      ++i;
    else if (!arguments[i].starts_with("-") && is_recording(arguments[i]))
      return arguments[i];
  }
  return "";
}

void run_python_loops(const fs::path& recording, const Arguments& arguments) {
  const char* const chosen = std::getenv("REVISIT_PYTHON");
  if (chosen != nullptr && has_package(chosen)) become_python(chosen, arguments);
  Arguments words = {"revisit-loops"};
  words.insert(words.end(), arguments.begin(), arguments.end());
  const int error = become(words);
  if (has_package("python3")) become_python("python3", arguments);
  throw InputError(
      recording.string(), ": bags and packets are read by the Python package of revisit, ",
      error == ENOENT ? "which is not installed"
                      : str("whose `revisit-loops` cannot be started (", std::strerror(error), ")"),
      "; run: pip install '.[bags]' in the root of the sources, then ",
      shell_command("revisit-loops", arguments));
}

}  // namespace revisit::cli
