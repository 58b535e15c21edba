#include "kernel.hpp"

namespace omnimirror {

const TrialKernel avx2_trials = &evaluate_batch;

}  // namespace omnimirror
