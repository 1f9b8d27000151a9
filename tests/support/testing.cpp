#include "testing.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <system_error>

#include "revisit/engine/machine.h"

namespace revisit::test {

namespace fs = std::filesystem;

fs::path shared(const std::string& relative) {
  const char* from_environment = std::getenv("REVISIT_TEST_DATA");
  const fs::path path =
      fs::path(from_environment ? from_environment : REVISIT_SHARED_DATA) / relative;
  return fs::exists(path) ? path : fs::path();
}

fs::path fixture(const std::string& relative) {
  return fs::path(REVISIT_FIXTURES) / relative;
}

fs::path golden(const std::string& relative) {
  return project_file("tests/golden/" + relative);
}

fs::path project_file(const std::string& relative) {
  return fs::path(REVISIT_ROOT) / relative;
}

TempDir::TempDir() {
  std::string path = fs::temp_directory_path() / "revisit_test_XXXXXX";
  if (!::mkdtemp(path.data()))
    throw std::system_error(errno, std::generic_category(), "mkdtemp " + path);
  path_ = path;
}

TempDir::~TempDir() {
  std::error_code ignored;
  fs::remove_all(path_, ignored);
}

void write_file(const fs::path& file, const std::string& content) {
  fs::create_directories(file.parent_path());
  std::ofstream out(file, std::ios::binary);
  out << content;
  if (!out.flush()) ADD_FAILURE() << "cannot write " << file;
}

std::string read_file(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream content;
  content << in.rdbuf();
  return std::move(content).str();
}

ProgramResult run_revisit(const std::string& arguments, const std::string& environment) {
  const TempDir dir;
  // Without it the program would restart itself, which doubles its start-up time.
  const std::string core = std::getenv("OPENBLAS_CORETYPE") ? "" : engine::faster_blas_core();
  const std::string command = (core.empty() ? "" : "export OPENBLAS_CORETYPE=" + core + "; ") +
                              environment + " '" + REVISIT_PROGRAM + "' " + arguments + " >'" +
                              (dir / "out").string() + "' 2>'" + (dir / "err").string() +
                              "' </dev/null";
  const int status = std::system(command.c_str());
  ProgramResult result;
  result.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  result.out = read_file(dir / "out");
  result.err = read_file(dir / "err");
  return result;
}

ProgramResult run_ok(const std::string& arguments, const std::string& environment) {
  ProgramResult result = run_revisit(arguments, environment);
  if (result.exit_code != 0)
    throw Error(
        str("revisit ", arguments, ": exit code ", result.exit_code, "\n", result.out, result.err));
  return result;
}

void expect_exit(int exit_code, std::initializer_list<std::string> parts,
                 const std::string& arguments, const std::string& environment) {
  const ProgramResult result = run_revisit(arguments, environment);
  EXPECT_EQ(result.exit_code, exit_code) << arguments << "\n" << result.err;
  for (const std::string& part : parts) EXPECT_HAS(result.err, part) << arguments;
}

}  // namespace revisit::test
