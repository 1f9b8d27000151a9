#include "experiment/catalog.h"

#include "revisit/proto/error.h"

namespace revisit::cli {

const std::vector<ExperimentInfo>& experiments() {
  static const std::vector<ExperimentInfo> all = {
      {"networks-and-layers", "Networks and layers",
       "Features of several networks, cut off at several layers, and the range image itself "
       "(`data`), on the median task.",
       "Every CNN feature is better than the vectorised range image; the best layer differs from "
       "network to network (AlexNet conv3+pool5, VGG-CNN-S conv4+pool5, Places-CNDS-8 pool5)."},
      {"easy-vs-median", "Easy against median task",
       "Every 3rd scan stored (easy) against one pass of the revisited streets stored (median).",
       "Easy is much better than median on 00 and 05; on 06 it drops, as scans of its fast "
       "stretches "
       "are far apart."},
      {"alignment", "With and without alignment",
       "Scans turned to their principal directions (case 1) against scans as they are.",
       "Alignment helps on every sequence and feature."},
      {"score", "Cosine against the score s",
       "Thresholding the cosine of the best match against s = 2 c1 - c4.",
       "s is slightly better in most cases, above all at high precision."},
      {"pca-dimensions", "Dimensions after PCA", "The feature reduced to fewer and fewer numbers.",
       "The curves are close together down to a few hundred dimensions; fewer can even be better."},
      {"bidirectional", "Revisits in the opposite direction",
       "Sequence 08, with its queries described in alignment case 1, in case 2, and in both.",
       "Either case alone fails; both together solve it."},
      {"comparison", "Comparison with other methods",
       "The proposed feature against hand-crafted point cloud descriptors, camera-based FAB-MAP "
       "and the range image, on the median task.",
       "The proposed feature is far better than VFH, ESF, GRSD and FAB-MAP at a comparable speed. "
       "(Scan Context and M2DP are not in the paper.)"},
      {"hkust-rotation", "HKUST: a turned sensor",
       "Seven places seen by a VLP-16 that is turned by about 40 degrees between scans; every 3rd, "
       "6th or 10th scan is stored.",
       "Precision stays above 0.8 at full recall."},
      {"hkust-objects", "HKUST: people and cars passing",
       "Seven places seen by a VLP-16 while people and cars pass; every 3rd, 6th or 10th scan is "
       "stored.",
       "The right place is always recognised."},
  };
  return all;
}

const ExperimentInfo& find_experiment(const std::string& name) {
  std::vector<std::string> names = {"all", "list"};
  for (const ExperimentInfo& info : experiments()) {
    if (info.name == name) return info;
    names.push_back(info.name);
  }
  throw UsageError(str("unknown experiment '", name, "'", did_you_mean(name, names),
                       "; 'revisit experiment list' shows them all"));
}

const std::vector<PaperMethod>& paper_methods() {
  static const std::vector<PaperMethod> methods = {
      {"cnn", "proposed", true, "PCA to 400 dimensions", 2.0},
      {"data", "range image (data)", false, "PCA to 400 dimensions", 0},
      {"vfh", "VFH", false, "normals within 0.03 m", 4.8},
      {"esf", "ESF", false, "", 18.0},
      {"grsd", "GRSD", false, "normals within 0.05 m, radius 0.1 m", 1.6},
      {"fabmap", "FAB-MAP", true, "SIFT, 400 words", 8.7},
      {"scan-context", "Scan Context", false, "20 rings, 60 sectors", 0, false},
      {"m2dp", "M2DP", false, "4 x 16 planes, 8 x 16 bins", 0, false},
  };
  return methods;
}

}  // namespace revisit::cli
