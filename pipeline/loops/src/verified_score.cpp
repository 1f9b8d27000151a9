#include "revisit/loops/verified_score.h"

namespace revisit {

const Calibration& verified_calibration() {
  // Computed by bench/verified_calibration.py.
  static const Calibration calibration = {
      .score = Score::kVerified,
      .trained_on = "NCLT, MulRan Riverside and 16 simulated drives",
      .blocks = {{-0.0093, 8066.9809, 0.1000},
                 {0.6160, 41.4551, 0.2000},
                 {0.6650, 5.5937, 0.1667},
                 {0.6766, 6.2692, 0.1909},
                 {0.7010, 31.1412, 1.6333},
                 {0.7571, 5.0667, 0.2909},
                 {0.7660, 14.9141, 1.9000},
                 {0.8116, 8.7723, 1.9497},
                 {0.8454, 2.6398, 0.9000},
                 {0.8683, 9.8858, 5.8202},
                 {0.9292, 395.3469, 393.9141},
                 {1.5967, 501.9342, 501.9342}}};
  return calibration;
}

}  // namespace revisit
