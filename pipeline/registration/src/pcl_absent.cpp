#include "revisit/proto/error.h"
#include "revisit/registration/registration.h"

// Stands for pcl/*.cpp in a build without PCL.

namespace revisit::pipeline {
namespace {

[[noreturn]] void fail() {
  throw UsageError(
      "registration: this program was built without PCL; install libpcl-dev and build it with "
      "-DREVISIT_PCL=ON");
}

}  // namespace

struct PreparedScan::Parts {};

PreparedScan::PreparedScan(const PointCloud&, const RegistrationOptions&) {
  fail();
}

int64_t PreparedScan::size() const {
  fail();
}

Registration register_scans(const PreparedScan&, const PreparedScan&, double,
                            const RegistrationOptions&) {
  fail();
}

}  // namespace revisit::pipeline
