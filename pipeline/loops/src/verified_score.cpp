#include "revisit/loops/verified_score.h"

namespace revisit::pipeline {

const Calibration& verified_calibration() {
  // Printed by tests/bench/verified_calibration.py.
  static const Calibration calibration = {
      .score = Score::kVerified,
      .learnt_from = "NCLT, MulRan Riverside and 16 simulated drives",
      .blocks = {{-0.0093, 8067.0, 0.1},
                 {0.6160, 41.5, 0.2},
                 {0.6650, 5.6, 0.2},
                 {0.6766, 6.3, 0.2},
                 {0.7010, 31.1, 1.6},
                 {0.7571, 5.1, 0.3},
                 {0.7660, 14.9, 1.9},
                 {0.8116, 8.8, 1.9},
                 {0.8454, 2.6, 0.9},
                 {0.8683, 9.9, 5.8},
                 {0.9292, 395.3, 393.9},
                 {1.5967, 501.9, 501.9}}};
  return calibration;
}

}  // namespace revisit::pipeline
