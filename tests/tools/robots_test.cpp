#include <sys/wait.h>
#include <unistd.h>

#include "postgres_server.h"
#include "testing.h"

namespace revisit::cli {
namespace {

using Cells = std::vector<std::string>;

/// Skips the header; cells have no quotes.
std::vector<Cells> csv(const std::string& text) {
  std::vector<Cells> lines;
  std::istringstream in(text);
  std::string line;
  std::getline(in, line);
  while (std::getline(in, line)) {
    Cells& cells = lines.emplace_back();
    std::istringstream of_line(line);
    for (std::string cell; std::getline(of_line, cell, ',');) cells.push_back(cell);
  }
  return lines;
}

class Robots : public testing::Test {
 protected:
  void SetUp() override {
    if (const std::string why = PostgresServer::missing(); !why.empty()) GTEST_SKIP() << why;
    server_.emplace();
  }
  std::string run(const std::string& command, int expected = 0) const {
    const auto result = test::run_revisit(command);
    EXPECT_EQ(result.exit_code, expected) << command << "\n" << result.err;
    return result.out;
  }
  std::string map() const { return "'" + server_->url("town") + "'"; }
  std::map<std::string, std::multiset<int>> entries() const {
    std::map<std::string, std::multiset<int>> frames;
    for (const Cells& entry : csv(run("map info --entries " + map())))
      frames[entry.at(1)].insert(std::stoi(entry.at(2)));
    return frames;
  }
  void wait_for_entries(int n) const {
    for (int tries = 0; tries < 600; ++tries) {
      try {
        if (std::stoi(server_->execute("SELECT count(*) FROM town.entry")) >= n) return;
      } catch (const std::runtime_error&) {  // the map does not exist yet
      }
      ::usleep(50'000);
    }
    ADD_FAILURE() << "no " << n << " entries in 30 s";
  }

  std::optional<PostgresServer> server_;
  TempDir folder_;
};

/// Two robots set out at one place, one along KITTI's route 00, the other along 05.
TEST_F(Robots, ShareEntriesWhileDriving) {
  constexpr int kFrames = 400, kEvery = 4;
  std::vector<std::string> lines;
  for (const char* route : {"00", "05"}) {
    REVISIT_NEED_SHARED(poses, std::string("data/kitti/poses/") + route + ".txt");
    std::ifstream in(poses);
    std::string line;
    for (int i = 0; i < kFrames && std::getline(in, line); ++i) lines.push_back(line);
  }
  std::vector<std::pair<double, double>> at;
  {
    std::ofstream poses(folder_ / "poses.txt");
    for (const std::string& line : lines) {
      poses << line << "\n";
      std::istringstream numbers(line);
      const std::vector<double> p{std::istream_iterator<double>(numbers), {}};
      at.emplace_back(p.at(3), p.at(11));
    }
  }
  run("simulate -o '" + (folder_ / "town").string() + "' --sensor vlp16 --poses '" +
      (folder_ / "poses.txt").string() + "' --every " + std::to_string(kEvery) + " -q");
  std::vector<std::string> found(2);
  std::vector<std::thread> robots;
  for (int robot = 0; robot < 2; ++robot) {
    const fs::path list = folder_ / ("list" + std::to_string(robot));
    std::ofstream out(list);
    for (int i = 0; i < kFrames; i += kEvery) {
      char name[20];
      std::snprintf(name, sizeof(name), "%06d.bin", robot * kFrames + i);
      out << (folder_ / "town/sequences/00/velodyne" / name).string() << "\n";
    }
    out.close();
    robots.emplace_back([this, robot, list, &found] {
      const std::string result = list.string() + ".csv";
      const std::string command = std::string("'") + REVISIT_PROGRAM +
                                  "' loops - --sensor vlp16 --exclusion frames=100 --warmup 50 -q "
                                  "--threads 1 --drive " +
                                  std::to_string(robot) + " --map " + map() + " -o '" + result +
                                  "' < '" + list.string() + "'";
      EXPECT_EQ(std::system(command.c_str()), 0);
      found[static_cast<size_t>(robot)] = read_file(result);
    });
  }
  wait_for_entries(60);
  server_->restart();
  for (std::thread& robot : robots) robot.join();

  int of_each_other = 0;
  std::vector<double> apart;  // distances of scans and their matches [m]
  for (int robot = 0; robot < 2; ++robot)
    for (const Cells& loop : csv(found[static_cast<size_t>(robot)])) {
      const int other = loop.at(2).empty() ? robot : std::stoi(loop.at(2));
      of_each_other += other != robot ? 1 : 0;
      const auto where = [&](const std::string& frame) {
        return at.at(static_cast<size_t>(std::stoi(frame)));
      };
      const auto a = where(loop.at(0)), b = where(loop.at(3));
      apart.push_back(std::hypot(a.first - b.first, a.second - b.second));
    }
  EXPECT_GE(of_each_other, 5);
  // Early scans are compared before the map mean is accurate.
  std::ranges::sort(apart);
  EXPECT_LT(apart.at(apart.size() / 2), 5);
  EXPECT_LT(apart.back(), 15);
  const auto kept = entries();
  for (const char* drive : {"0", "1"}) {
    EXPECT_EQ(kept.at(drive).size(), kFrames / kEvery);
    EXPECT_EQ(std::set<int>(kept.at(drive).begin(), kept.at(drive).end()).size(), kFrames / kEvery);
  }
}

TEST_F(Robots, DescribeOneDataSetDespiteKills) {
  const std::string town = (folder_ / "town").string();
  run("simulate -o '" + town + "' --sensor vlp16 --length 400 --every 2 -q");
  const std::string url = server_->url("town");
  const auto start = [&] {
    const pid_t child = ::fork();
    if (child == 0) {
      ::execl(REVISIT_PROGRAM, "revisit", "map", "build", town.c_str(), "--sensor", "vlp16",
              "--threads", "1", "--warmup", "30", "-q", "--map", url.c_str(), nullptr);
      std::_Exit(1);
    }
    return child;
  };
  // The claims of killed processes go to others, also while the server restarts.
  std::array processes = {start(), start()};
  for (int kill = 0; kill < 4; ++kill) {
    wait_for_entries(30 * (kill + 1));
    pid_t& killed = processes.at(kill % 2);
    ::kill(killed, SIGKILL);
    if (kill == 1) server_->restart();
    int status = 0;
    ::waitpid(killed, &status, 0);
    EXPECT_TRUE(WIFSIGNALED(status)) << "it ended before it was killed";
    killed = start();
  }
  for (const pid_t process : processes) {
    int status = 0;
    ::waitpid(process, &status, 0);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
  }

  std::multiset<int> expected;
  for (const auto& scan : fs::directory_iterator(town + "/sequences/00/velodyne"))
    expected.insert(std::stoi(scan.path().stem()));
  EXPECT_EQ(entries().at("00"), expected);
  const std::string again = run("map build '" + town + "' --sensor vlp16 --map " + map());
  EXPECT_HAS(again, " 0 added by this process");
}

/// Two processes share one of the recordings.
TEST_F(Robots, KeepFoldersOfOneNameApart) {
  run("simulate -o '" + (folder_ / "town").string() +
      "' --sensor vlp16 --length 400 --every 12 -q");
  std::vector<fs::path> scans;
  for (const auto& scan : fs::directory_iterator(folder_ / "town/sequences/00/velodyne"))
    scans.push_back(scan.path());
  std::ranges::sort(scans);
  const std::vector<size_t> ends = {0, 9, 19, 30};
  ASSERT_GE(scans.size(), ends.back());
  const auto folder = [&](size_t i) { return folder_ / std::to_string(i) / "scans"; };
  for (size_t i = 0; i + 1 < ends.size(); ++i) {
    fs::create_directories(folder(i));
    for (size_t scan = ends[i]; scan < ends[i + 1]; ++scan)
      fs::create_symlink(scans[scan], folder(i) / (std::to_string(scan - ends[i]) + ".bin"));
  }
  const auto build = [&](size_t i) {
    return run("map build '" + folder(i).string() + "' --sensor vlp16 --threads 1 " + "--map " +
               map());
  };
  std::vector<std::thread> processes;
  for (const size_t i : {0, 1, 2, 0}) processes.emplace_back([&, i] { build(i); });
  for (std::thread& process : processes) process.join();

  auto stored = entries();
  const auto frames_of = [&](const std::string& drive) {
    const std::set<int> frames(stored[drive].begin(), stored[drive].end());
    EXPECT_EQ(frames.size(), stored[drive].size()) << drive << ": each once";
    return frames.size();
  };
  EXPECT_EQ((std::multiset<size_t>{frames_of("scans"), frames_of("scans-2"), frames_of("scans-3")}),
            (std::multiset<size_t>{9, 10, 11}));
  EXPECT_EQ(stored.size(), 3);
  for (const size_t i : {0, 1, 2})  // none was mixed with another
    EXPECT_HAS(build(i), " 0 added by this process");
}

}  // namespace
}  // namespace revisit::cli
