// The kernels for every machine.
#include "axial_kernel.hpp"
#include "common.hpp"

namespace omnimirror {

const Kernels plain_kernels{"plain", &sample<Plain>, &pack<Plain>, &project_targets};

}  // namespace omnimirror
