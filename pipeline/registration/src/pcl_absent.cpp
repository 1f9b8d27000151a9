#include "revisit/recognition/optional_library.h"
#include "revisit/registration/registration.h"

// Stands for pcl/*.cpp in a build without PCL.

namespace revisit::pipeline {

Registration register_scans(const PreparedScan&, const PreparedScan&, double,
                            const RegistrationOptions&) {
  built_without("registration", "PCL");
}

}  // namespace revisit::pipeline
