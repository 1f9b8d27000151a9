#include "doctor/checks.h"

namespace revisit::doctor {

const char* to_string(Status status) {
  switch (status) {
    case Status::kOk:
      return "ok";
    case Status::kWarn:
      return "warn";
    case Status::kMissing:
      return "missing";
  }
  return "";
}

}  // namespace revisit::doctor
