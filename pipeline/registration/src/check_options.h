#pragma once

#include "revisit/registration/registration.h"

namespace revisit::pipeline {

/// Throws UsageError, naming the field that cannot be.
void check(const RegistrationOptions& options);

}  // namespace revisit::pipeline
