#include "plots/gnuplot.h"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstring>

#include "revisit/proto/atomic_file.h"
#include "revisit/proto/error.h"

extern char** environ;

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// Look of every plot: quiet axes, a light grid, and colours that also differ for the colour-blind
/// (Okabe and Ito).
constexpr const char* kStyle = R"(set encoding utf8
set border 3 linewidth 1.2 linecolor rgb '#555555'
set tics nomirror out scale 0.6 textcolor rgb '#333333'
set grid linecolor rgb '#e4e4e4' linewidth 1 linetype 1, linecolor rgb '#e4e4e4' linewidth 1 linetype 1
set linetype 1 linecolor rgb '#0072b2' linewidth 2.6
set linetype 2 linecolor rgb '#d55e00' linewidth 2.6
set linetype 3 linecolor rgb '#009e73' linewidth 2.6
set linetype 4 linecolor rgb '#cc79a7' linewidth 2.6
set linetype 5 linecolor rgb '#e69f00' linewidth 2.6
set linetype 6 linecolor rgb '#56b4e9' linewidth 2.6
set linetype 7 linecolor rgb '#000000' linewidth 2.6
set linetype cycle 7
set key noenhanced spacing 1.25 textcolor rgb '#222222'
set title offset 0,0.4 font ',17' noenhanced
)";

/// Runs `gnuplot SCRIPT` in `folder`; returns "" or what went wrong.
std::string run_gnuplot(const fs::path& folder, const std::string& script) {
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addchdir_np(&actions, folder.c_str());
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
  posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
  std::string program = "gnuplot", argument = script;
  char* const argv[] = {program.data(), argument.data(), nullptr};
  pid_t child = 0;
  const int error = posix_spawnp(&child, "gnuplot", &actions, nullptr, argv, environ);
  posix_spawn_file_actions_destroy(&actions);
  if (error == ENOENT) return "gnuplot is not installed (Debian: apt install gnuplot-nox)";
  if (error != 0) return str("gnuplot cannot be started: ", std::strerror(error));
  int status = 0;
  while (::waitpid(child, &status, 0) < 0)
    if (errno != EINTR) return str("gnuplot was lost: ", std::strerror(errno));
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return "";
  return str("gnuplot failed; 'gnuplot ", script, "' in ", folder.string(), " says why");
}

}  // namespace

std::string quoted(const std::string& text) {
  std::string literal = "'";  // in single quotes gnuplot interprets nothing but the quote
  for (const char c : text) literal += c == '\'' ? "''" : c == '\n' ? " " : std::string(1, c);
  return literal + "'";
}

PlotFiles draw(const fs::path& folder, const std::string& name, const std::string& data,
               const std::string& commands, int height) {
  const fs::path absolute = fs::absolute(folder);
  const PlotFiles files{absolute / (name + ".dat"), absolute / (name + ".gp"),
                        absolute / (name + ".png"), absolute / (name + ".svg"), ""};
  std::error_code ignored;
  fs::create_directories(absolute, ignored);
  // A picture of an earlier run must not stand beside the new data.
  fs::remove(files.png, ignored);
  fs::remove(files.svg, ignored);
  write_atomically(files.data, [&](std::ostream& out) { out << data; });
  write_atomically(files.script, [&](std::ostream& out) {
    out << "# Drawn by revisit; edit and run: gnuplot " << name << ".gp\n"
        << "set terminal pngcairo size 1200," << height
        << " font 'Sans,14' background rgb 'white'\n"
        << "set output " << quoted(name + ".png") << "\n"
        << kStyle << commands << "\n"
        << "set terminal svg size 1200," << height << " font 'Sans,14' background rgb 'white'\n"
        << "set output " << quoted(name + ".svg") << "\nreplot\nunset output\n";
  });
  PlotFiles result = files;
  const std::string problem = run_gnuplot(absolute, name + ".gp");
  if (problem.empty()) return result;
  fs::remove(files.png, ignored);
  fs::remove(files.svg, ignored);
  result.warning = str("no picture for ", files.script.string(), ": ", problem);
  return result;
}

}  // namespace revisit::cli
