#include "fuzz.h"
#include "revisit/engine/tensor.h"
#ifdef REVISIT_HAVE_PIPELINE
#include "cli/options.h"
#include "revisit/datasets/describe.h"
#include "revisit/evaluation/ground_truth.h"
#include "revisit/evaluation/protocols.h"
#include "revisit/recognition/match.h"
#include "revisit/recognition/range_image.h"
#endif

namespace revisit::fuzz {
namespace {

void read_shape(const std::string& text) {
  works_or_refuses([&] {
    const engine::Shape shape = engine::Shape::parse(text);
    require(engine::Shape::parse(shape.text()) == shape, "a shape is read back unchanged");
  });
}

#ifdef REVISIT_HAVE_PIPELINE

Trajectory drive() {
  return {.frames = {0, 1, 5, 90},
          .positions = {{0, 0, 0}, {1, 0, 0}, {5, 0, 0}, {0, 0, 0}},
          .times = {0, 0.1, 0.5, 9}};
}

template <class T>
void read_value(const std::string& text) {
  works_or_refuses([&] { cli::parse_value<T>("--option", text); });
}

void read_for_pipeline(const std::string& text) {
  using namespace revisit;
  works_or_refuses([&] {
    const Exclusion exclusion = parse_exclusion(text);
    require(parse_exclusion(to_string(exclusion)) == exclusion,
            "an exclusion is read back unchanged");
    earlier_candidates(drive(), exclusion);
    later_candidates(drive(), exclusion);
  });
  works_or_refuses([&] { make_tasks(text, "00", drive()); });
  works_or_refuses([&] { make_tasks("paper", text, drive()); });
  works_or_refuses([&] { parse_distance(text); });
  works_or_refuses([&] { parse_score(text); });
  works_or_refuses([&] { parse_align_case(text); });
  works_or_refuses([&] { sensor_geometry(text); });
  read_value<std::filesystem::path>(text);
  read_value<int>(text);
  read_value<int64_t>(text);
  read_value<uint64_t>(text);
  read_value<double>(text);
  read_value<bool>(text);
}

#else

void read_for_pipeline(const std::string&) {}

#endif

}  // namespace
}  // namespace revisit::fuzz

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const std::string text = revisit::fuzz::text(data, size);
  revisit::fuzz::read_shape(text);
  revisit::fuzz::read_for_pipeline(text);
  return 0;
}
