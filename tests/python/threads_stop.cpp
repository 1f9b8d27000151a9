// CPython 3.14 and later block a thread that requests the lock of a finalizing interpreter, instead
// of ending it.
#include <unistd.h>

extern "C" [[noreturn]] void pthread_exit(void* /*result*/) {
  for (;;) ::pause();
}
