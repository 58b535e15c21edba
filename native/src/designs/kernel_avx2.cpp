#include "kernel.hpp"

namespace omnimirror {

const DesignKernel avx2_designs = &evaluate_batch;

}  // namespace omnimirror
