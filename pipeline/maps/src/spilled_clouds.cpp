#include "spilled_clouds.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>

#include "revisit/base/error.h"

namespace revisit::pipeline {
namespace {

[[noreturn]] void fail_spilled() {
  throw Error("the file for the points of places, in TMPDIR or /var/tmp: ", std::strerror(errno));
}

int nameless_file() {
  const char* const chosen = std::getenv("TMPDIR");
  // /tmp may be memory, as the last way out is.
  for (const char* folder :
       {chosen != nullptr && *chosen != '\0' ? chosen : "/var/tmp", "/var/tmp", "/tmp"}) {
    std::string name = str(folder, "/revisit-XXXXXX");
    const int file = ::mkostemp(name.data(), O_CLOEXEC);
    if (file < 0) continue;
    ::unlink(name.c_str());
    return file;
  }
  const int file = ::memfd_create("revisit", MFD_CLOEXEC);
  if (file < 0) fail_spilled();
  return file;
}

}  // namespace

SpilledClouds::~SpilledClouds() {
  if (file_ >= 0) ::close(file_);
}

void SpilledClouds::take(std::span<StoredPlace> places) {
  std::vector<int64_t> ends = {ends_.back()};
  for (const StoredPlace& place : places) {
    if (file_ < 0 && !place.cloud.empty()) file_ = nameless_file();
    for (size_t done = 0; done < place.cloud.size();) {
      const ssize_t n = ::pwrite(file_, place.cloud.data() + done, place.cloud.size() - done,
                                 ends.back() + static_cast<int64_t>(done));
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) fail_spilled();
      done += static_cast<size_t>(n);
    }
    ends.push_back(ends.back() + std::ssize(place.cloud));
  }
  ends_.insert(ends_.end(), ends.begin() + 1, ends.end());
  for (StoredPlace& place : places) std::string().swap(place.cloud);
}

std::string SpilledClouds::of(int64_t place) const {
  const auto at = static_cast<size_t>(place);
  std::string cloud(static_cast<size_t>(ends_[at + 1] - ends_[at]), '\0');
  for (size_t done = 0; done < cloud.size();) {
    const ssize_t n = ::pread(file_, cloud.data() + done, cloud.size() - done,
                              ends_[at] + static_cast<int64_t>(done));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) fail_spilled();
    done += static_cast<size_t>(n);
  }
  return cloud;
}

}  // namespace revisit::pipeline
