#pragma once

#include "revisit/registration/registration.h"

namespace revisit::pipeline {

/// Throws UsageError, naming the invalid field.
void check(const RegistrationOptions& options);

}  // namespace revisit::pipeline
