#include "revisit/recognition/optional_library.h"
#include "revisit/registration/registration.h"

// Stands for pcl/*.cpp in a build without PCL.

namespace revisit::pipeline {

struct PreparedScan::Parts {};

PreparedScan::PreparedScan(const PointCloud&, const RegistrationOptions&) {
  built_without("registration", "PCL");
}

int64_t PreparedScan::size() const {
  built_without("registration", "PCL");
}

Registration register_scans(const PreparedScan&, const PreparedScan&, double,
                            const RegistrationOptions&) {
  built_without("registration", "PCL");
}

}  // namespace revisit::pipeline
