// A script replaces the Python package that reads recordings.
#include "loops/recording.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <thread>

#include "cli/shell.h"
#include "test_data.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

class Recording : public testing::Test {
 protected:
  Recording() {
    test::write_file(bag(), "#ROSBAG V2.0");
    fs::create_directories(dir_ / "bin");
  }
  std::string bag() const { return (dir_ / "drive.bag").string(); }
  void install(const std::string& name, const std::string& script) const {
    test::write_file(dir_ / ("bin/" + name), "#!/bin/sh\n" + script);
    fs::permissions(dir_ / ("bin/" + name), fs::perms::owner_all);
  }
  /// Runs with the installed scripts alone on PATH.
  test::ProgramResult run(const std::string& arguments, const std::string& environment = "") const {
    return test::run_revisit(arguments, environment + " PATH=" + (dir_ / "bin").string());
  }

  test::TempDir dir_;
};

TEST_F(Recording, IsReadByRevisitLoopsWithTheSameArgumentsAndExitCode) {
  install("revisit-loops", "for word; do echo \"<$word>\"; done\necho said >&2\nexit 6\n");
  const auto result =
      run("loops --topic '/a b' -q " + shell_word(bag()) + " --threshold=1 --plot x.png");
  EXPECT_EQ(result.exit_code, 6) << result.err;
  EXPECT_EQ(result.out,
            "<--topic>\n</a b>\n<-q>\n<" + bag() + ">\n<--threshold=1>\n<--plot>\n<x.png>\n");
  EXPECT_EQ(result.err, "said\n");
  fs::create_directories(dir_ / "ros2");
  test::write_file(dir_ / "ros2/metadata.yaml", "");
  fs::create_directories(dir_ / "parts");
  for (const char* name : {"one.mcap", "one.db3", "one.pcap", "one.osf", "parts/1.bag"})
    test::write_file(dir_ / name, "");
  for (const char* name : {"ros2", "one.mcap", "one.db3", "one.pcap", "one.osf", "parts"}) {
    const std::string recording = (dir_ / name).string();
    EXPECT_EQ(run("loops " + shell_word(recording)).out, "<" + recording + ">\n");
  }
}

TEST_F(Recording, IsReadByThePackageOfAnInterpreter) {
  const std::string python =
      "test \"$1\" = -c || exit 1\nshift 2\n"
      "case $# in 0) exit 0;; *) echo \"NAME $*\"; exit 5;; esac\n";
  for (const char* name : {"python3", "chosen"})
    install(name, std::string(python).replace(python.find("NAME"), 4, name));
  auto result = run("loops " + bag() + " --all");
  EXPECT_EQ(result.exit_code, 5) << result.err;
  EXPECT_EQ(result.out, "python3 " + bag() + " --all\n");
  install("revisit-loops", "exit 6\n");
  EXPECT_EQ(run("loops " + bag()).exit_code, 6);
  result = run("loops " + bag(), "REVISIT_PYTHON=" + (dir_ / "bin/chosen").string());
  EXPECT_EQ(result.out, "chosen " + bag() + "\n");
  EXPECT_EQ(run("loops " + bag(), "REVISIT_PYTHON=/nowhere").exit_code, 6);
}

TEST_F(Recording, WithoutThePackageTheCommandToRunIsNamed) {
  const auto expect_named = [&] {
    const auto result = run("loops " + bag() + " --topic '/a b'");
    EXPECT_EQ(result.exit_code, 3);
    EXPECT_EQ(result.out, "");
    for (const std::string& part : {"revisit: " + bag(), std::string("pip install '.[bags]'"),
                                    "revisit-loops " + bag() + " --topic '/a b'"})
      EXPECT_NE(result.err.find(part), std::string::npos) << result.err;
  };
  expect_named();
  install("python3", "exit 1\n");  // without the package
  expect_named();
  install("revisit-loops", "");
  fs::permissions(dir_ / "bin/revisit-loops", fs::perms::owner_read);
  expect_named();
}

TEST_F(Recording, IsOnlyTheArgumentAndNotTheValueOfAnOption) {
  install("revisit-loops", "exit 6\n");
  EXPECT_EQ(run("loops /nowhere --calibrate " + bag()).exit_code, 3);
  EXPECT_EQ(run("loops /nowhere -o " + bag()).exit_code, 3);
  test::write_file(dir_ / "scan.bin", "");
  EXPECT_EQ(run("loops " + (dir_ / "scan.bin").string()).exit_code, 3);
  EXPECT_EQ(run("loops --help").exit_code, 0);
}

TEST_F(Recording, SignalsReachTheReader) {
  install("revisit-loops",
          "trap 'exit 42' INT\n: > " + (dir_ / "ready").string() + "\nwhile :; do :; done\n");
  const pid_t child = ::fork();
  if (child == 0) {
    ::setenv("PATH", (dir_ / "bin").c_str(), 1);
    ::execl(REVISIT_PROGRAM, "revisit", "loops", bag().c_str(), nullptr);
    ::_exit(1);
  }
  for (int i = 0; i < 3000 && !fs::exists(dir_ / "ready"); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  ::kill(child, SIGINT);
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 42);
}

}  // namespace
}  // namespace revisit::cli
