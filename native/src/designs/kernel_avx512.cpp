#include "kernel.hpp"

namespace omnimirror {

const DesignKernel avx512_designs = &evaluate_batch;

}  // namespace omnimirror
