#include "check_options.h"

#include "revisit/base/error.h"

namespace revisit::pipeline {
namespace {

void check(const char* name, double value, double least, double most) {
  if (!(value >= least && value <= most))
    throw UsageError(
        str("RegistrationOptions::", name, ": expected ", least, " to ", most, ", found ", value));
}

}  // namespace

void check(const RegistrationOptions& options) {
  check("voxel", options.voxel, 0.05, 5);
  check("max_range", options.max_range, 1, 200);
  check("reach", options.reach, 0, 20);
  check("max_distance", options.max_distance, 0.01, 20);
  check("inlier_distance", options.inlier_distance, 0.01, 20);
  check("least_inliers", options.least_inliers, 0, 1);
  check("least_constraint", options.least_constraint, 0, 1);
}

}  // namespace revisit::pipeline
