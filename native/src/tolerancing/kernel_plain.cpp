#include "kernel.hpp"

namespace omnimirror {

const TrialKernel plain_trials = &evaluate_batch;

}  // namespace omnimirror
