#pragma once

#include <string>

namespace revisit::engine {

/// The set of kernels OpenBLAS uses, e.g. "SkylakeX". It is chosen when the library is loaded.
std::string blas_core();

/// A faster set that this CPU can run, when OpenBLAS uses a lesser one: it falls back to SSE3
/// kernels on CPUs newer than itself (up to ten times slower), and OPENBLAS_CORETYPE may hold it
/// back. Empty when there is none. To be set as OPENBLAS_CORETYPE before the program starts.
std::string faster_blas_core();

}  // namespace revisit::engine
