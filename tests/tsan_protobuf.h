// Included before every file of a thread-sanitizer build. MapFieldBase has two more fields if
// __SANITIZE_THREAD__ is defined. Debian's libprotobuf lacks them, so that the map of a
// google::protobuf::Struct would lie elsewhere.
#pragma push_macro("__SANITIZE_THREAD__")
#undef __SANITIZE_THREAD__
#include <google/protobuf/map_field.h>
#pragma pop_macro("__SANITIZE_THREAD__")
