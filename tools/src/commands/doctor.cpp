#include <algorithm>
#include <iostream>

#include "cli/command.h"
#include "cli/json.h"
#include "cli/options.h"
#include "doctor/checks.h"
#include "reports.pb.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

void print_text(const doctor::Checks& checks) {
  size_t width = 0;
  for (const doctor::Check& check : checks) width = std::max(width, check.name.size());
  std::string section;
  for (const doctor::Check& check : checks) {
    if (check.section != section)
      std::cout << (section.empty() ? "" : "\n") << check.section << "\n";
    section = check.section;
    std::cout << "  " << check.status << std::string(9 - check.status.size(), ' ') << check.name
              << std::string(width + 2 - check.name.size(), ' ') << check.found << "\n";
    if (!check.advice.empty()) std::cout << std::string(11, ' ') << "-> " << check.advice << "\n";
  }
}

void print_json(const doctor::Checks& checks, bool ok) {
  reports::DoctorReport report;
  report.set_ok(ok);
  for (const doctor::Check& check : checks) {
    reports::DoctorCheck& item = *report.add_checks();
    item.set_section(check.section);
    item.set_name(check.name);
    item.set_status(check.status);
    item.set_found(check.found);
    item.set_advice(check.advice);
    item.set_essential(check.essential);
  }
  std::cout << to_json(report);
}

struct DoctorOptions {
  std::optional<fs::path> data;
  std::string format = "table";

  void declare(Options& options) {
    options.argument("DATA", &data).optional();
    options.choice("format", {"table", "json"}, "format of standard output (default table)",
                   &format);
  }
};

int check_all(const DoctorOptions& o) {
  doctor::Checks checks;
  doctor::check_program(checks);
  doctor::check_machine(checks);
  doctor::check_models(checks);
  if (o.data) doctor::check_data(*o.data, checks);

  const bool ok = std::none_of(checks.begin(), checks.end(), [](const doctor::Check& check) {
    return check.essential && check.status == doctor::Status::kMissing;
  });
  if (o.format == "json") {
    print_json(checks, ok);
  } else {
    print_text(checks);
    std::cout << (ok ? "\neverything essential works\n"
                     : "\nsomething essential is missing, see above\n");
  }
  return ok ? kOk : kCheckFailed;
}

}  // namespace

Command doctor_command() {
  return {"doctor", "check the installation, models and data",
          "Checks the program, the machine, the models and DATA, and prints what is missing and "
          "how to fix it. Exit code 5 if something essential is missing.",
          "  revisit doctor\n  revisit doctor /data/kitti\n",
          with_options<DoctorOptions>(check_all)};
}

}  // namespace revisit::cli
