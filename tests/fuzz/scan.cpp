// A scan, and the range image of it. The first byte tells the format, as it does in files: 'p'
// begins a PLY, '#' or one of the header's words a PCD; all else is KITTI's .bin.
#include "fuzz.h"
#include "revisit/pipeline/describe.h"
#include "revisit/pipeline/scan_file.h"

namespace revisit::fuzz {
namespace {

const char* extension_of(const std::string& bytes) {
  if (bytes.starts_with('p')) return ".ply";
  constexpr std::string_view kPcdStarts = "#VFCSTWHPD";
  return !bytes.empty() && kPcdStarts.find(bytes[0]) != std::string_view::npos ? ".pcd" : ".bin";
}

void make_images(const pipeline::PointCloud& cloud) {
  using pipeline::AlignMode;
  pipeline::ImageGeometry geometry;
  geometry.width = 40;
  geometry.height = 8;
  for (const AlignMode mode : {AlignMode::kNone, AlignMode::kCase1, AlignMode::kCase2})
    works_or_refuses([&] { pipeline::scan_to_image(cloud, mode, geometry); });
}

}  // namespace
}  // namespace revisit::fuzz

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace revisit;
  const std::string bytes = fuzz::text(data, size);
  const fuzz::InputFile file(bytes, fuzz::extension_of(bytes));
  fuzz::works_or_refuses([&] {
    const pipeline::PointCloud cloud = pipeline::read_scan(file.path());
    fuzz::require(!cloud.points.empty(), "a scan that is read has points");
    fuzz::make_images(cloud);
  });
  return 0;
}
