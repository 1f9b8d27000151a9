#include "module.h"

#include "unlocked.h"

NB_MODULE(_core, core) {
  using namespace revisit::python;
  core.doc() = "Bindings of revisit's C++ libraries, one module per library.";
  core.attr("__version__") = REVISIT_VERSION;
  translate_errors();
  wait_for_threads_at_exit();

  const auto library = [&](const char* name, const char* doc, void (*bind)(nb::module_&)) {
    nb::module_ module = core.def_submodule(name, doc);
    bind(module);
  };
  library("proto", "Caffe's network and weights files.", bind_proto);
  library("engine", "Inference of Caffe networks on the CPU.", bind_engine);
#ifdef REVISIT_HAVE_PIPELINE
  library("recognition", "Features of scans.", bind_recognition);
  library("datasets", "Sequences and folders of scans.", bind_datasets);
  library("evaluation", "Evaluation of place recognition.", bind_evaluation);
  library("maps", "Maps, place recognition and loop detection.", bind_maps);
  library("registration", "Registration of two scans of a place.", bind_registration);
  library("simulation", "Simulated drives through synthetic worlds.", bind_simulation);
#endif
}
