// From 3.14 on CPython does not end a thread that asks for the lock of an interpreter that ends:
// the thread stops where it is.
#include <unistd.h>

extern "C" [[noreturn]] void pthread_exit(void* /*result*/) {
  for (;;) ::pause();
}
