#include "kernel.hpp"

namespace omnimirror {

const DesignKernel plain_designs = &evaluate_batch;

}  // namespace omnimirror
