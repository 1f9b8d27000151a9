#pragma once

namespace revisit::cli {

/// Starts the program again with OPENBLAS_CORETYPE set when OpenBLAS did not recognise the CPU and
/// fell back to kernels far below it. Does nothing when the user set the variable, or when starting
/// again fails.
void restart_with_faster_blas(char** argv);

}  // namespace revisit::cli
