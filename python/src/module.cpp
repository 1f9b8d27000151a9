#include "module.h"

#include "unlocked.h"

NB_MODULE(_core, core) {
  using namespace revisit::python;
  core.doc() = "What revisit's C++ libraries offer to Python: a module a library.";
  core.attr("__version__") = REVISIT_VERSION;
  translate_errors();
  wait_for_threads_at_exit();

  const auto library = [&](const char* name, const char* doc, void (*bind)(nb::module_&)) {
    nb::module_ module = core.def_submodule(name, doc);
    bind(module);
  };
  library("proto", "Files of Caffe's networks.", bind_proto);
  library("engine", "Caffe networks on the CPU.", bind_engine);
#ifdef REVISIT_HAVE_PIPELINE
  library("recognition", "From scans to features.", bind_recognition);
  library("datasets", "Drives and folders of scans.", bind_datasets);
  library("evaluation", "How well places are recognised.", bind_evaluation);
  library("maps", "Places, kept and recognised.", bind_maps);
  library("registration", "How two scans of a place lie to each other.", bind_registration);
  library("simulation", "Drives through synthetic worlds.", bind_simulation);
#endif
}
