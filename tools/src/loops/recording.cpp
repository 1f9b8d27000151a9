#include "loops/recording.h"

#include <fcntl.h>
#include <poll.h>
#include <reports.pb.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <istream>
#include <memory>
#include <streambuf>
#include <thread>

#include "cli/command.h"
#include "cli/json.h"
#include "cli/terminal.h"
#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/base/hash.h"
#include "revisit/datasets/scan_file.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// "" is not among the paths that `-c` searches, because anyone may own the working directory.
constexpr const char* kProgram = R"(import sys
sys.path[:] = filter(None, sys.path)
try:
    from revisit.recordings.__main__ import main
except ImportError as error:
    import json
    print(json.dumps({'code': 3, 'error': f'{sys.argv[-1]}: bags, packets and data sets are read by '
        f'the Python package of revisit, which {sys.executable} cannot import ({error}); run: pip '
        "install '.[bags]' in the root of the sources, in a virtual environment, or set REVISIT_PYTHON to an interpreter with it"}))
    sys.exit(3)
)";

bool is_bag(const fs::path& file) {
  constexpr std::array kEndings = {".bag", ".db3", ".mcap"};
  return std::ranges::find(kEndings, file.extension().string()) != kEndings.end();
}

/// Reads a pipe until its end or an interrupt.
class PipeBuffer : public std::streambuf {
 public:
  explicit PipeBuffer(int pipe) : pipe_(pipe) {}

 protected:
  int_type underflow() override {
    constexpr int kMoment = 100;  // [ms]; an interrupt just before poll() does not end it
    pollfd pipe{pipe_, POLLIN, 0};
    int ready = 0;
    while ((ready = ::poll(&pipe, 1, kMoment)) == 0 || (ready < 0 && errno == EINTR))
      if (interrupted()) return traits_type::eof();
    const ssize_t n = ready > 0 ? ::read(pipe_, bytes_.data(), bytes_.size()) : 0;
    if (n <= 0) return traits_type::eof();
    setg(bytes_.data(), bytes_.data(), bytes_.data() + n);
    return traits_type::to_int_type(bytes_[0]);
  }

 private:
  int pipe_;
  std::array<char, 1 << 16> bytes_;
};

/// A process whose standard output is read.
class ReaderProcess {
 public:
  explicit ReaderProcess(Arguments words) : buffer_(start(words)), in_(&buffer_) {}
  ~ReaderProcess() {
    ::close(pipe_);
    stop();
  }
  ReaderProcess(const ReaderProcess&) = delete;
  ReaderProcess& operator=(const ReaderProcess&) = delete;

  std::istream& output() { return in_; }

  /// Why the output has ended.
  std::string ending() {
    const int status = stop();
    if (WIFSIGNALED(status)) return str("; its reader was killed by signal ", WTERMSIG(status));
    return str("; its reader exited with code ", WEXITSTATUS(status));
  }

 private:
  int start(Arguments& words) {
    std::array<int, 2> ends{};
    if (::pipe2(ends.data(), O_CLOEXEC) != 0)
      throw Error("cannot create a pipe: ", std::strerror(errno));
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_adddup2(&actions, ends[1], STDOUT_FILENO);
    // A group of its own, so that Ctrl-C on a terminal reaches this process alone, which ends both.
    posix_spawnattr_t attributes;
    posix_spawnattr_init(&attributes);
    sigset_t defaults;
    sigemptyset(&defaults);
    sigaddset(&defaults, SIGINT);
    posix_spawnattr_setsigdefault(&attributes, &defaults);
    posix_spawnattr_setpgroup(&attributes, 0);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGDEF);
    std::vector<char*> argv;
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    const int error = ::posix_spawnp(&child_, argv[0], &actions, &attributes, argv.data(), environ);
    posix_spawnattr_destroy(&attributes);
    posix_spawn_file_actions_destroy(&actions);
    ::close(ends[1]);
    pipe_ = ends[0];
    if (error == 0) return pipe_;
    ::close(pipe_);
    throw InputError(words.back(),
                     ": bags, packets and data sets are read by the Python package of "
                     "revisit, but ",
                     words[0], " cannot be started (", std::strerror(error),
                     "); install it, or set REVISIT_PYTHON to an interpreter");
  }

  /// Returns the status of the process. It ends by itself unless it reads without writing.
  int stop() {
    using Clock = std::chrono::steady_clock;
    constexpr std::chrono::milliseconds kMoment{2}, kUntilInterrupt{500}, kUntilKill{3000};
    if (child_ == 0) return status_;
    const Clock::time_point start = Clock::now();
    for (int signal = SIGINT; ::waitpid(child_, &status_, WNOHANG) == 0;) {
      std::this_thread::sleep_for(kMoment);
      if (Clock::now() - start < (signal == SIGINT ? kUntilInterrupt : kUntilKill)) continue;
      ::kill(child_, signal);
      signal = SIGKILL;
    }
    child_ = 0;
    return status_;
  }

  pid_t child_ = 0;
  int pipe_ = -1, status_ = 0;
  PipeBuffer buffer_;
  std::istream in_;
};

constexpr int kFormatVersion = 1;

[[noreturn]] void throw_error(const reports::ScanLine& line) {
  switch (line.code()) {
    case kUsage:
      throw UsageError(line.error());
    case kBadInput:
      throw InputError(line.error());
    case kUnsupported:
      throw UnsupportedError(line.error());
    default:
      throw Error(line.error());
  }
}

class RecordedStream {
 public:
  RecordedStream(std::istream& in, std::string source, std::function<std::string()> ending)
      : in_(in), source_(std::move(source)), ending_(std::move(ending)) {}

  reports::ScanLine header(const std::string& text) const {
    reports::ScanLine line = parsed(text);
    if (line.revisit_scans() != kFormatVersion)
      throw InputError(source_, ": expected scans in format ", kFormatVersion, ", found format ",
                       line.revisit_scans(), "; install the same version of everything");
    return line;
  }

  std::string next_line() {
    std::string text;
    if (!std::getline(in_, text) || in_.eof()) throw_early_end();
    return text;
  }

  std::optional<ScanRef> next() {
    if (ended_) return std::nullopt;
    const reports::ScanLine line = parsed(next_line());
    if (line.end()) {
      ended_ = true;
      return std::nullopt;
    }
    ScanRef scan;
    scan.file = line.source();
    scan.frame = line.frame();
    if (scans_ > 0 && scan.frame <= frame_)
      throw InputError(line.source(), ": expected frames that ascend, found ", scan.frame,
                       " after ", frame_);
    frame_ = scan.frame;
    if (line.has_time()) scan.time = line.time();
    if (line.pose_size() > 0) scan.pose = pose_of(line);
    ++scans_;
    if (!line.error().empty()) {
      scan.read = [error = line.error()](PointCloud&) { throw InputError(error); };
      return scan;
    }
    const auto points = std::make_shared<PointCloud>(points_of(line));
    scan.read = [points](PointCloud& cloud) { cloud = *points; };
    return scan;
  }

 private:
  reports::ScanLine parsed(const std::string& text) const {
    reports::ScanLine line;
    parse_report(text, source_, &line);
    if (line.has_code()) throw_error(line);
    return line;
  }

  Pose pose_of(const reports::ScanLine& line) const {
    constexpr int kRows = 3, kColumns = 4;
    if (line.pose_size() != kRows * kColumns)
      throw InputError(line.source(), ": expected a pose of 12 numbers, found ", line.pose_size());
    Pose pose = Pose::Identity();
    for (int i = 0; i < kRows * kColumns; ++i)
      pose.matrix()(i / kColumns, i % kColumns) = line.pose(i);
    return pose;
  }

  /// Reads pieces, because the number of points may be wrong.
  std::vector<float> floats(size_t n) {
    constexpr size_t kPiece = size_t{1} << 20;
    std::vector<float> values;
    while (values.size() < n) {
      const size_t at = values.size(), more = std::min(kPiece, n - at);
      values.resize(at + more);
      const auto bytes = static_cast<std::streamsize>(more * sizeof(float));
      if (!in_.read(reinterpret_cast<char*>(&values[at]), bytes)) throw_early_end();
    }
    return values;
  }

  PointCloud points_of(const reports::ScanLine& line) {
    const size_t n = line.points();
    const std::vector<float> xyz = floats(3 * n);
    PointCloud cloud;
    cloud.points.resize(n);
    for (size_t i = 0; i < n; ++i)
      cloud.points[i] = {xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2], 0};
    if (line.times()) cloud.times = floats(n);
    return cloud;
  }

  [[noreturn]] void throw_early_end() const {
    if (interrupted()) throw Interrupted("interrupted while reading ", source_);
    throw InputError(source_, ": the stream ends too early, after ", scans_, " scans", ending_());
  }

  std::istream& in_;
  std::string source_;
  std::function<std::string()> ending_;
  int64_t scans_ = 0;
  int frame_ = 0;  // of the last scan
  bool ended_ = false;
};

/// Folders and files that data sets have.
constexpr std::array kMarks = {"metadata.yaml",  "samples/LIDAR_TOP",    "sweeps/LIDAR_TOP",
                               "data_3d_raw",    "velodyne_points/data", "LiDAR/Ouster",
                               "LiDAR/Velodyne", "LiDAR/Avia",           "LiDAR/Aeva",
                               "Ouster",         "sensor_data/Ouster",   "velodyne_sync"};

bool has_scans_of_recordings(const fs::path& folder) {
  bool arrays = false, scans = false;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
    const std::string name = entry.path().filename().string();
    if (is_bag(entry.path()) || name.starts_with("v1.0-") || name.ends_with(".pcd.bin"))
      return true;
    arrays = arrays || name.ends_with(".npy");
    scans = scans || is_scan_file_name(entry.path());
  }
  return arrays && !scans;
}

std::string checksum_of(const PointCloud& cloud) {
  uint64_t hash = kFnv1aStart;
  for (const auto part :
       {std::as_bytes(std::span(cloud.points)), std::as_bytes(std::span(cloud.times))})
    for (size_t at = 0; at < part.size(); at += sizeof(uint32_t)) {
      uint32_t word = 0;
      std::memcpy(&word, &part[at], sizeof word);
      hash = fnv1a(hash, word);
    }
  return std::to_string(hash);
}

}  // namespace

bool is_recording(const fs::path& data) {
  std::error_code error;
  if (fs::is_regular_file(data, error))
    return is_bag(data) || data.extension() == ".pcap" || data.extension() == ".osf";
  return std::ranges::any_of(kMarks,
                             [&](const char* mark) { return fs::exists(data / mark, error); }) ||
         has_scans_of_recordings(data);
}

bool begins_recorded_scans(const std::string& line) {
  return line.starts_with("{\"revisit_scans\":");
}

RecordedScans recorded_scans(std::istream& in, const std::string& source, std::string first,
                             const std::function<std::string()>& ending) {
  const auto stream = std::make_shared<RecordedStream>(in, source, ending);
  if (first.empty()) first = stream->next_line();
  const reports::ScanLine line = stream->header(first);
  return {line.name(),
          line.count(),
          {line.warnings().begin(), line.warnings().end()},
          line.point_times(),
          [stream] { return stream->next(); }};
}

std::string python_interpreter() {
  const char* const python = std::getenv("REVISIT_PYTHON");
  return python != nullptr ? python : "python3";
}

Arguments reader_options(const FeatureOptions& options) {
  Arguments words;
  for (const auto& [option, value] :
       {std::pair("--sequence=", options.sequence), std::pair("--topics=", options.topics),
        std::pair("--extrinsics=", options.extrinsics.string()),
        std::pair("--point-times=",
                  options.point_times == "auto" ? std::string() : options.point_times)})
    if (!value.empty()) words.push_back(option + value);
  return words;
}

RecordedScans read_recording(const FeatureOptions& options, bool headers) {
  Arguments words = {python_interpreter(), "-c",
                     str(kProgram, "sys.exit(main(headers=", headers ? "True" : "False", "))"),
                     str("--every=", options.every)};
  std::ranges::move(reader_options(options), std::back_inserter(words));
  words.push_back("--");
  words.push_back(options.data.string());
  const auto reader = std::make_shared<ReaderProcess>(std::move(words));
  RecordedScans scans = recorded_scans(reader->output(), options.data.string(), "",
                                       [reader = reader.get()] { return reader->ending(); });
  scans.next = [reader, next = std::move(scans.next)] { return next(); };
  return scans;
}

Dataset headers_of(const FeatureOptions& data) {
  Dataset dataset;
  for (const ScanStream next = read_recording(data, true).next; auto scan = next();) {
    dataset.n_poses += scan->pose ? 1 : 0;
    dataset.scans.push_back(std::move(*scan));
  }
  return dataset;
}

Dataset spooled(const RecordedScans& scans) {
  Dataset dataset;
  dataset.name = scans.name;
  dataset.warnings = scans.warnings;
  dataset.point_times = scans.point_times;
  const auto file = std::make_shared<UnnamedFile>();
  PointCloud cloud;
  while (std::optional<ScanRef> scan = scans.next()) {
    dataset.n_poses += scan->pose ? 1 : 0;
    try {
      scan->read(cloud);
      scan->checksum = checksum_of(cloud);
      const int64_t at = file->append(std::as_bytes(std::span(cloud.points)));
      file->append(std::as_bytes(std::span(cloud.times)));
      scan->read = [file, at, points = cloud.points.size(),
                    times = cloud.times.size()](PointCloud& out) {
        out.points.resize(points);
        out.times.resize(times);
        const auto bytes = std::as_writable_bytes(std::span(out.points));
        file->read(at, bytes);
        file->read(at + std::ssize(bytes), std::as_writable_bytes(std::span(out.times)));
      };
    } catch (const InputError&) {  // thrown again by each reading
    }
    dataset.scans.push_back(std::move(*scan));
  }
  return dataset;
}

}  // namespace revisit::cli
