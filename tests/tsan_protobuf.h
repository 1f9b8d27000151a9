// Read before every file of a build with the thread sanitizer. protobuf's MapFieldBase has two
// fields more where __SANITIZE_THREAD__ is defined, but Debian's libprotobuf is compiled without
// it: our code and the library would look for the map of a google::protobuf::Struct at different
// places.
#pragma push_macro("__SANITIZE_THREAD__")
#undef __SANITIZE_THREAD__
#include <google/protobuf/map_field.h>
#pragma pop_macro("__SANITIZE_THREAD__")
